#include "tests/geometry/shapes.hpp"

#include <algorithm>
#include <cmath>

#include "pipeline/contract/atomic_file.hpp"
#include "pipeline/contract/log.hpp"

namespace viscera::testing {

LabelImage nested_balls(double outer, double inner) {
  LabelImage image = draw(48, {1.1, 1.0, 1.25}, [=](double x, double y, double z) {
    if (std::hypot(x - 4.0, y + 3.0, z) < inner) return 2;
    return std::hypot(x, y, z) < outer ? 1 : 0;
  });
  image.names = {{1, "liver"}, {2, "tumour"}};
  return image;
}

Outcome run_stage(const Stage& stage, std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), stage.info.name);
  std::vector<char*> argv;
  for (auto& argument : arguments) argv.push_back(argument.data());
  ::testing::internal::CaptureStderr();
  ::testing::internal::CaptureStdout();
  const int code = stage_main(static_cast<int>(argv.size()), argv.data(), stage);
  ::testing::internal::GetCapturedStdout();
  return {code, ::testing::internal::GetCapturedStderr()};
}

Json read_json(const std::filesystem::path& path) {
  return Json::parse(read_file(path));
}

Json metric(const std::filesystem::path& folder, const std::string& name) {
  const Json manifest = read_json(folder / "manifest.json");
  for (const auto& entry : manifest.at("metrics"))
    if (entry.at("name") == name) return entry.at("value");
  return nullptr;
}

std::vector<std::string> files_in(const std::filesystem::path& folder) {
  std::vector<std::string> names;
  if (!std::filesystem::exists(folder)) return names;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder))
    names.push_back(entry.path().filename().string());
  std::sort(names.begin(), names.end());
  return names;
}

}  // namespace viscera::testing
