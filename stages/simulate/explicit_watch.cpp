#include "stages/simulate/explicit_watch.hpp"

#include <fmt/format.h>

#include "pipeline/base/log.hpp"

namespace viscera {

std::string ExplicitWatch::operator()(const sim::State& state) {
  const sim::ExplicitLimit limit = sim::explicit_limit(model_, scene_, state);
  if (!limit.exact || limit.courant <= allowed) return "";
  const bool first = !objected_;
  objected_ = true;
  if (scene_.stability != sim::StabilityPolicy::warn) return explain(limit);
  if (first) log::warn("{}", explain(limit));
  return "";
}

std::string ExplicitWatch::explain(const sim::State& last) const {
  return explain(sim::explicit_limit(model_, scene_, last));
}

std::string ExplicitWatch::explain(const sim::ExplicitLimit& limit) const {
  return fmt::format(
      "a Courant number of {:.2f} as deformed then, where explicit steps blow up above 1: "
      "time.substeps of {:.0f} or more are needed in place of {}",
      limit.courant, limit.substeps_needed, scene_.time.substeps);
}

}  // namespace viscera
