# Installs BUILD into an empty folder PLACE, builds EXAMPLE against it there, and runs it on PHANTOM: its body
# must hang still, held by what it weighs within 1 %.
file(REMOVE_RECURSE ${PLACE})
execute_process(COMMAND ${CMAKE_COMMAND} --install ${BUILD} --prefix ${PLACE}/usr OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${CMAKE_COMMAND} -S ${EXAMPLE} -B ${PLACE}/build -DCMAKE_PREFIX_PATH=${PLACE}/usr
                OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${CMAKE_COMMAND} --build ${PLACE}/build OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${PLACE}/build/hanging-body ${PHANTOM} OUTPUT_VARIABLE said COMMAND_ERROR_IS_FATAL ANY)
message("${said}")
if(NOT said MATCHES "^([0-9]+) tets weigh ([0-9.]+) N and are held with ([0-9.]+) N\n$")
  message(FATAL_ERROR "the example says something else")
endif()
# In thousandths of a newton: CMake has no fractions.
string(REPLACE "." "" weight ${CMAKE_MATCH_2})
string(REPLACE "." "" held ${CMAKE_MATCH_3})
math(EXPR apart "${weight} - ${held}")
math(EXPR allowed "${weight} / 100")
if(apart GREATER allowed OR apart LESS -${allowed})
  message(FATAL_ERROR "held by other forces than its weight")
endif()
execute_process(COMMAND ${PLACE}/usr/bin/viscera --version OUTPUT_QUIET COMMAND_ERROR_IS_FATAL ANY)
file(REMOVE_RECURSE ${PLACE})
