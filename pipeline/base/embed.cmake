# embed(TARGET FILE…): puts files into the target as the assembler's .incbin does, byte for byte.
# NAME of web/report.css is report_css; the symbols are viscera_file_NAME and viscera_file_NAME_end (embedded_file.hpp).
function(embed target)
  set(text "  .section .rodata\n")
  foreach(file IN LISTS ARGN)
    get_filename_component(name ${file} NAME)
    string(MAKE_C_IDENTIFIER viscera_file_${name} symbol)
    string(APPEND text "  .global ${symbol}, ${symbol}_end\n${symbol}:\n  .incbin \"${file}\"\n"
                       "${symbol}_end:\n")
  endforeach()
  string(APPEND text "  .section .note.GNU-stack, \"\", %progbits\n")
  set(source ${CMAKE_CURRENT_BINARY_DIR}/${target}_files.S)
  file(CONFIGURE OUTPUT ${source} CONTENT "${text}" @ONLY)
  set_source_files_properties(${source} PROPERTIES OBJECT_DEPENDS "${ARGN}")
  target_sources(${target} PRIVATE ${source})
endfunction()
