#include "pipeline/contract/input_digest.hpp"

#include <algorithm>
#include <cctype>
#include <fstream>
#include <optional>

namespace viscera {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t max_header_line = 1 << 16;
constexpr int max_header_lines = 1 << 16;  // a list of slices has one line each

std::string trimmed(const std::string& text) {
  const auto begin = text.find_first_not_of(" \t\r");
  const auto end = text.find_last_not_of(" \t\r");
  return begin == std::string::npos ? "" : text.substr(begin, end - begin + 1);
}

std::string lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

// The next line of a text header; nothing at the end of the file or where pixels begin.
std::optional<std::string> text_line(std::istream& file) {
  std::string line;
  for (int c = file.get(); c != EOF; c = file.get()) {
    if (c == '\n') return line;
    const bool binary = c < ' ' && c != '\t' && c != '\r';
    if (binary || line.size() == max_header_line) return std::nullopt;
    line += static_cast<char>(c);
  }
  return line.empty() ? std::nullopt : std::optional(line);
}

// "NDims = 3", as every line of a MetaImage header is; not an XML tag with attributes.
bool is_meta_line(const std::string& line) {
  const auto mark = line.find('=');
  if (mark == std::string::npos) return false;
  const std::string name = trimmed(line.substr(0, mark));
  return !name.empty() && std::all_of(name.begin(), name.end(),
                                      [](unsigned char c) { return std::isalnum(c) != 0; });
}

// What stands behind "data file:" or "ElementDataFile =", and the lines after it.
struct DataField {
  std::string value;
  std::vector<std::string> rest;
};

std::optional<DataField> data_field(const fs::path& header) {
  std::ifstream file(header, std::ios::binary);
  const auto first = text_line(file);
  if (!first) return std::nullopt;
  const bool nrrd = first->starts_with("NRRD");
  if (!nrrd && !is_meta_line(*first)) return std::nullopt;
  auto line = first;
  for (int count = 0; line && count < max_header_lines; line = text_line(file), ++count) {
    if (nrrd && trimmed(*line).empty()) return std::nullopt;  // its data follow
    const auto mark = line->find(nrrd ? ':' : '=');
    if (mark == std::string::npos) continue;
    const std::string name = lower(trimmed(line->substr(0, mark)));
    if (nrrd ? name != "data file" && name != "datafile" : name != "elementdatafile") continue;
    DataField field{.value = trimmed(line->substr(mark + 1))};
    while ((line = text_line(file)) && field.rest.size() < max_header_lines) {
      field.rest.push_back(trimmed(*line));
    }
    return field;
  }
  return std::nullopt;
}

void add_if_file(std::vector<fs::path>& files, const fs::path& file) {
  std::error_code failure;
  if (fs::is_regular_file(file, failure)) files.push_back(file);
}

// "slices/s%03d.raw 1 90 1": files that begin and end as the pattern does.
std::vector<fs::path> matching(const fs::path& folder, const std::string& pattern) {
  const auto percent = pattern.find('%');
  const auto letter = pattern.find_first_not_of("0123456789-+ #", percent + 1);
  if (letter == std::string::npos) return {};
  const fs::path before = folder / pattern.substr(0, percent);
  const std::string start = before.filename().string(), end = pattern.substr(letter + 1);
  std::vector<fs::path> files;
  std::error_code failure;
  for (const auto& entry : fs::directory_iterator(before.parent_path(), failure)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with(start) && name.ends_with(end)) add_if_file(files, entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

std::vector<fs::path> named_data(const fs::path& folder, const DataField& field) {
  std::vector<fs::path> files;
  if (lower(field.value) == "local") return files;
  if (field.value == "LIST" || field.value.starts_with("LIST ")) {
    for (const auto& name : field.rest) add_if_file(files, folder / name);
    return files;
  }
  add_if_file(files, folder / field.value);
  if (!files.empty() || field.value.find('%') == std::string::npos) return files;
  return matching(folder, field.value.substr(0, field.value.find_first_of(" \t")));
}

// The other half of a NIfTI or ANALYZE pair, whichever half was named.
std::vector<fs::path> nifti_pair(const fs::path& path) {
  std::string name = path.string();
  if (name.ends_with(".gz")) name.resize(name.size() - 3);
  const bool header = name.ends_with(".hdr");
  if (!header && !name.ends_with(".img")) return {};
  name.resize(name.size() - 4);
  name += header ? ".img" : ".hdr";
  std::vector<fs::path> files;
  add_if_file(files, name);
  add_if_file(files, name + ".gz");
  return files;
}

FileDigest folder_digest(const fs::path& folder, const FileHasher& hash) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_regular_file()) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  KeyTranscript parts;
  FileDigest total{.path = folder.string()};
  for (const auto& file : files) {
    parts.add("file", file.lexically_relative(folder).string(), hash(file));
    total.bytes += fs::file_size(file);
  }
  total.sha256 = parts.key();
  return total;
}

}  // namespace

std::vector<fs::path> detached_data(const fs::path& header) {
  const auto pair = nifti_pair(header);
  if (!pair.empty()) return pair;
  const auto field = data_field(header);
  return field ? named_data(header.parent_path(), *field) : std::vector<fs::path>{};
}

FileDigest input_digest(const fs::path& path, const FileHasher& hash) {
  std::error_code failure;
  if (fs::is_directory(path, failure)) return folder_digest(path, hash);
  FileDigest total{.path = path.string(), .sha256 = hash(path), .bytes = fs::file_size(path)};
  const auto data = detached_data(path);
  if (data.empty()) return total;
  KeyTranscript parts;
  parts.add("header", "", total.sha256);
  for (const auto& file : data) {
    parts.add("data", file.filename().string(), hash(file));
    total.bytes += fs::file_size(file);
  }
  total.sha256 = parts.key();
  return total;
}

}  // namespace viscera
