#include "pipeline/record/crate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <iomanip>
#include <set>
#include <sstream>

namespace viscera::engine {
namespace {

constexpr const char* crate_version = "https://w3id.org/ro/crate/1.1";

Json reference(const std::string& id) {
  return {{"@id", id}};
}

// A name as a relative URI (RFC 3986).
std::string uri(const std::string& name) {
  constexpr std::string_view plain =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-._~/+=";
  std::string text;
  for (const char c : name) {
    if (plain.find(c) != std::string_view::npos) {
      text += c;
    } else {
      text += fmt::format("%{:02X}", static_cast<unsigned char>(c));
    }
  }
  return text;
}

std::string format_of(const std::string& name) {
  const std::pair<const char*, const char*> formats[] = {
      {".json", "application/json"}, {".md", "text/markdown"},      {".html", "text/html"},
      {".csv", "text/csv"},          {".png", "image/png"},         {".h5", "application/x-hdf5"},
      {".vtu", "application/xml"},   {".vtp", "application/xml"},   {".xdmf", "application/xml"},
      {".inp", "text/plain"},        {".glb", "model/gltf-binary"}, {".feb", "application/xml"}};
  for (const auto& [ending, format] : formats) {
    if (name.ends_with(ending)) return format;
  }
  return "application/octet-stream";
}

std::string input_id(const FileDigest& input) {
  return "#input-" + input.sha256;
}

// When a stage that started at this time, "2026-11-26T15:30:00Z", had ended.
std::string end_of(const std::string& started, double wall_s) {
  std::tm time{};
  std::istringstream text(started);
  text >> std::get_time(&time, "%Y-%m-%dT%H:%M:%SZ");
  if (!text) return "";
  const auto begin = std::chrono::system_clock::from_time_t(timegm(&time));
  const std::time_t end = std::chrono::system_clock::to_time_t(
      begin + std::chrono::seconds(static_cast<long>(wall_s + 0.5)));
  std::tm utc{};
  gmtime_r(&end, &utc);
  char written[32];
  std::strftime(written, sizeof written, "%Y-%m-%dT%H:%M:%SZ", &utc);
  return written;
}

std::string last_day(const FinishedRun& run) {
  std::string last;
  for (const FinishedStage& stage : run.stages) last = std::max(last, stage.manifest.started);
  return last.substr(0, last.find('T'));
}

class Graph {
 public:
  Graph(const FinishedRun& run, const std::vector<RecordFile>& files) : run_(run), files_(files) {}

  Json all(const std::string& license) {
    add({{"@id", "ro-crate-metadata.json"},
         {"@type", "CreativeWork"},
         {"conformsTo", reference(crate_version)},
         {"about", reference("./")}});
    add_root();
    add({{"@id", "#license"},
         {"@type", "CreativeWork"},
         {"name", license.empty() ? "No licence was stated" : license},
         {"description", license.empty() ? "Ask whoever made the run."
                                         : "As stated when the record was written."}});
    for (const auto& file : files_) {
      add({{"@id", uri(file.name)},
           {"@type", "File"},
           {"name", file.title},
           {"encodingFormat", format_of(file.name)},
           {"contentSize", fmt::format("{}", file.bytes)},
           {"sha256", file.sha256}});
    }
    for (const FinishedStage& stage : run_.stages) add_stage(stage);
    return std::move(graph_);
  }

 private:
  void add(Json entity) { graph_.push_back(std::move(entity)); }

  void add_root() {
    Json parts = Json::array(), actions = Json::array();
    for (const auto& file : files_) parts.push_back(reference(uri(file.name)));
    for (const FinishedStage& stage : run_.stages) actions.push_back(reference("#" + stage.name()));
    add({{"@id", "./"},
         {"@type", "Dataset"},
         {"name", fmt::format("Record of the run {}", run_.name)},
         {"description",
          "A soft-tissue simulation: its methods, parameters, results and their credibility, with "
          "the files that its stages wrote."},
         {"datePublished", last_day(run_)},
         {"license", reference("#license")},
         {"hasPart", std::move(parts)},
         {"mentions", std::move(actions)}});
  }

  void add_stage(const FinishedStage& stage) {
    const Manifest& manifest = stage.manifest;
    const std::string program = "viscera-" + stage.name();
    add({{"@id", "#" + program},
         {"@type", "SoftwareApplication"},
         {"name", program},
         {"softwareVersion", manifest.version}});
    Json objects = Json::array(), results = Json::array();
    for (const auto& [role, input] : manifest.inputs) objects.push_back(reference(input_of(input)));
    for (const auto& output : manifest.outputs)
      results.push_back(reference(uri(stage.name() + "/" + output.path)));
    add({{"@id", "#" + stage.name()},
         {"@type", "CreateAction"},
         {"name", fmt::format("The stage {}", stage.name())},
         {"instrument", reference("#" + program)},
         {"object", std::move(objects)},
         {"result", std::move(results)},
         {"startTime", manifest.started},
         {"endTime", end_of(manifest.started, manifest.wall_s)}});
  }

  // The file of the record that it is, or else an entity of its own: files that no stage made are
  // not part of the record, since they may be the patient's.
  std::string input_of(const FileDigest& input) {
    const auto inside = std::ranges::find(files_, input.sha256, &RecordFile::sha256);
    if (inside != files_.end()) return uri(inside->name);
    if (inputs_.insert(input.sha256).second) {
      add({{"@id", input_id(input)},
           {"@type", "CreativeWork"},
           {"name", file_name(input.path)},
           {"contentSize", fmt::format("{}", input.bytes)},
           {"sha256", input.sha256}});
    }
    return input_id(input);
  }

  const FinishedRun& run_;
  const std::vector<RecordFile>& files_;
  std::set<std::string> inputs_;
  Json graph_ = Json::array();
};

}  // namespace

Json crate_metadata(const FinishedRun& run, const std::vector<RecordFile>& files,
                    const std::string& license) {
  // The context of version 1.1 is older than the term sha256 of schema.org.
  return {{"@context",
           {crate_version + std::string("/context"), {{"sha256", "https://schema.org/sha256"}}}},
          {"@graph", Graph(run, files).all(license)}};
}

}  // namespace viscera::engine
