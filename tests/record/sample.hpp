// A finished simulation as viscera-simulate describes it, small enough to be read.
#pragma once

#include "pipeline/record/finished_run.hpp"

namespace viscera::engine {

inline FinishedRun sample_run() {
  Manifest manifest{
      .stage = "simulate",
      .version = "14",
      .params = {{"solver", "xpbd"},
                 {"element", nullptr},
                 {"scheme", "auto"},
                 {"iterations", 1},
                 {"precision", "fp32"},
                 {"device", "auto"},
                 {"certify", false},
                 {"threads", 2}},
      .metrics = {{"scheme", "gauss_seidel", "1"},
                  {"element", "smoothed", "1"},
                  {"time_order", 2, "1"},
                  {"substeps", 64, "1"},
                  {"frames", 126, "1"},
                  {"effects_on", {"gravity", "viscosity", "smoothed_neo_hookean", "ground"}, "1"},
                  {"effects_off", {"fixed"}, "1"},
                  {"rest_time", 2.1, "s"},
                  {"wall", 3.0, "s", true}},
      .gates = {{"inverted_end", 0.0, "<=", 0.0}},
      .device = "cpu, 2 threads",
      .started = "2026-11-26T15:30:00Z"};
  FinishedRun run{.folder = "out/demo", .name = "demo", .stages = {}, .scene = {}};
  run.scene = {
      {"materials",
       {{"liver", {{"E", 5000.0}, {"nu", 0.45}, {"density", 1060.0}, {"damping", 0.02}}},
        {"tumour", {{"E", 15000.0}, {"nu", 0.45}, {"density", 1060.0}, {"damping", 0.02}}}}},
      {"effects",
       {{"gravity", {{"acceleration", 9.80665}}}, {"smoothed_neo_hookean", Json::object()}}},
      {"effect_units", {{"gravity", {{"acceleration", "m/s2"}}}}},
      {"time", {{"frame", 0.0166}, {"substeps", 64}}}};
  run.stages.push_back({.manifest = std::move(manifest),
                        .folder = "out/demo/simulate",
                        .key = "k",
                        .transcript = "",
                        .origins = {}});
  return run;
}

}  // namespace viscera::engine
