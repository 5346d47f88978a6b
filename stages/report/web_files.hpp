// The files of web/ and the two JavaScript libraries, as embedded at build time (embed.cmake).
#pragma once

#include <string_view>
#include <vector>

namespace viscera::web {

// What a stage's page is made of; shell.html stands around it.
struct Page {
  std::string_view stage;
  std::string_view first;                 // the id of its first section
  std::string_view main;                  // what stands in <main>
  std::vector<std::string_view> scripts;  // in the order in which they must run
};

Page report();
Page compare();
Page cohort();  // no 3D view, so without three.js

std::string_view shell();     // shell.html with its {{places}}
std::string_view style();     // report.css
std::string_view licences();  // of the libraries

}  // namespace viscera::web
