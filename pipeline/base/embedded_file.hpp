// A file that the build has put into a program (embed.cmake). NAME of web/report.css is report_css.
//
//   VISCERA_EMBEDDED_FILE(report_css);                            // outside of namespaces
//   std::string_view style = VISCERA_EMBEDDED_TEXT(report_css);
#pragma once

#include <string_view>

// The file lies between two symbols.
#define VISCERA_EMBEDDED_FILE(name)            \
  extern "C" const char viscera_file_##name[]; \
  extern "C" const char viscera_file_##name##_end[]

#define VISCERA_EMBEDDED_TEXT(name) \
  std::string_view(viscera_file_##name, viscera_file_##name##_end - viscera_file_##name)
