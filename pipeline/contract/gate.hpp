// Quality gates: what a stage declares of each of them, what a run found, and the words in which a
// failure is told. Places are LPS millimetres.
#pragma once

#include <array>
#include <string>
#include <vector>

#include "pipeline/base/param.hpp"

namespace viscera {

class JsonValue;

// A gate as its stage declares it. Whoever reads of its failure must learn what the result is worth
// and what to do, so that nothing here may be left out.
struct GateInfo {
  // @param unit "1" for numbers without dimension
  // @param meaning what a failure means for the result, a sentence
  // @param remedy what to change: the parameters by name, and in which direction
  // Throws std::invalid_argument for an empty text and for a comparison that is not ">=" or "<=".
  GateInfo(std::string name, std::string comparison, std::string unit, std::string meaning,
           std::string remedy);

  std::string name, comparison, unit, meaning, remedy;
};

Json to_json(const GateInfo& info);

// What a run knows of a gate beyond its value; all of it may be empty.
struct GateDetails {
  std::string of;     // which of several was judged, a label: the gate is called "liver.lost"
  std::string where;  // in words: "superior side of the image"
  std::vector<std::array<double, 3>> at;  // LPS mm, the worst first; 100 are kept
  std::string remedy;                     // in place of the declared one: with the run's numbers
};

// A gate as it was judged.
struct Gate {
  std::string name;
  double value = 0.0;
  std::string comparison;  // ">=" or "<="
  double limit = 0.0;
  std::string unit = "1";
  std::string meaning = {}, remedy = {}, where = {};  // as in GateInfo and GateDetails
  std::vector<std::array<double, 3>> at = {};

  bool passed() const { return comparison == ">=" ? value >= limit : value <= limit; }
};

Gate judged(const GateInfo& info, double value, double limit, GateDetails details = {});

// Whether a gate of this name and comparison is one of those declared.
bool is_declared(const Gate& gate, const std::vector<GateInfo>& declared);

// "gate border_area: 56 mm2, required <= 0 mm2", and a line each for what a failure means, where it
// is and what to do.
std::string failure_message(const Gate& gate);

Json to_json(const Gate& gate);
// Gates of manifests that earlier versions wrote have no texts and no places.
Gate gate_from_json(const JsonValue& json);

}  // namespace viscera
