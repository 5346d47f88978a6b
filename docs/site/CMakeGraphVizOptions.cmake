# The drawing of our own libraries and programs, from the build's graph: what each says that it needs.
set(GRAPHVIZ_GRAPH_NAME viscera)
set(GRAPHVIZ_GRAPH_HEADER "rankdir=LR; node [fontname=Helvetica fontsize=12];")
foreach(kind EXTERNAL_LIBS UNKNOWN_LIBS CUSTOM_TARGETS GENERATE_PER_TARGET GENERATE_DEPENDERS)
  set(GRAPHVIZ_${kind} FALSE)
endforeach()
# Of the tests, and what stands on everything else or under it.
set(GRAPHVIZ_IGNORE_TARGETS "^test_" "^bench_" "^viscera_options$" "^viscera_sample_run$" "^viscera_results$" "^make-" "^fake_stage$" "^mutate$"
    "shapes$" "phantom" "^image_bytes$" "::" "^itk" "^ITK" "^fmt" "^yaml" "^dcm")
