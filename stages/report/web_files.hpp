// The files of web/ and the two JavaScript libraries, as embedded at build time (embed.cmake).
#pragma once

#include <string_view>
#include <vector>

namespace viscera::web {

std::string_view skeleton();              // report.html with its {{places}}
std::string_view style();                 // report.css
std::string_view licences();              // of the libraries, for every skeleton's footer
std::vector<std::string_view> scripts();  // in the order in which they must run

std::string_view compare_skeleton();  // compare.html, with the same style
std::vector<std::string_view> compare_scripts();

std::string_view cohort_skeleton();  // cohort.html: no 3D view, so without three.js
std::vector<std::string_view> cohort_scripts();

}  // namespace viscera::web
