#include "pipeline/python/named_mesh.hpp"

namespace viscera::python {

Said said_by(const StageInfo& info, const StageRun& run) {
  Manifest manifest = manifest_of(info, run);
  manifest.params = run.params();
  Said said{.manifest = to_json(manifest)};
  for (const Metric& metric : run.metrics())
    if (!metric.machine) said.metrics[metric.name] = metric.value;
  for (const Gate& gate : run.gates()) {
    said.gates.push_back(to_json(gate));
    said.gates.back()["passed"] = gate.passed();
  }
  for (const auto& caveat : run.caveats()) said.caveats.push_back(caveat);
  return said;
}

}  // namespace viscera::python
