#include "stages/image/header_checks.hpp"

#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>

namespace viscera {
namespace fs = std::filesystem;
namespace {

constexpr std::uint64_t max_numbers = std::uint64_t{1} << 29;
constexpr std::uint64_t max_header = 1 << 24;
constexpr std::uint64_t slack = 1 << 16;  // bytes behind the data that some writers leave

template <class Number>
std::vector<Number> parse(const HeaderChecks& checks, const std::string& field,
                          const std::string& text) {
  constexpr const char* between = " \t\r,()";
  std::vector<Number> numbers;
  for (auto begin = text.find_first_not_of(between); begin != std::string::npos;
       begin = text.find_first_not_of(between, text.find_first_of(between, begin))) {
    const auto end = std::min(text.find_first_of(between, begin), text.size());
    const char *first = &text[begin] + (text[begin] == '+'), *last = text.data() + end;
    Number number{};
    const auto [stop, error] = std::from_chars(first, last, number);
    if (error != std::errc{} || stop != last)
      checks.refuse(field, fmt::format("'{}'", text.substr(begin, end - begin)), "numbers");
    numbers.push_back(number);
    if (end == text.size()) break;
  }
  return numbers;
}

// Bytes that a deflated stream expands to; stops a little beyond `wanted`.
class Inflater {
 public:
  explicit Inflater(const StoredData& data) : in_(data.file, std::ios::binary) {
    in_.seekg(static_cast<std::streamoff>(data.offset));
    ok_ = inflateInit2(&stream_, 15 + 32) == Z_OK;  // 32: gzip or zlib, told by its first bytes
  }
  ~Inflater() { inflateEnd(&stream_); }
  Inflater(const Inflater&) = delete;
  Inflater& operator=(const Inflater&) = delete;

  // Whether the stream ended as it should; `out` receives the bytes it gave.
  bool count(std::uint64_t wanted, std::uint64_t& out) {
    out = 0;
    while (ok_) {
      if (stream_.avail_in == 0 && !refill()) return whole_;
      stream_.next_out = reinterpret_cast<Bytef*>(expanded_.data());
      stream_.avail_out = static_cast<uInt>(expanded_.size());
      const int state = inflate(&stream_, Z_NO_FLUSH);
      const std::uint64_t got = expanded_.size() - stream_.avail_out;
      out += got;
      if (out > wanted + slack) return true;
      whole_ = state == Z_STREAM_END;
      if (whole_ && inflateReset(&stream_) != Z_OK) return false;  // gzip members may follow
      if (state != Z_OK && !whole_) return out >= wanted && after_a_member_;
      after_a_member_ |= whole_;
    }
    return false;
  }

 private:
  bool refill() {
    in_.read(packed_.data(), static_cast<std::streamsize>(packed_.size()));
    stream_.next_in = reinterpret_cast<Bytef*>(packed_.data());
    stream_.avail_in = static_cast<uInt>(in_.gcount());
    return stream_.avail_in > 0;
  }

  std::ifstream in_;
  z_stream stream_{};
  std::vector<char> packed_ = std::vector<char>(1 << 16), expanded_ = std::vector<char>(1 << 18);
  bool ok_ = false, whole_ = false, after_a_member_ = false;
};

}  // namespace

Error bad_image(const fs::path& path, std::string field, std::string found, std::string allowed,
                std::string remedy) {
  return Error(ExitCode::bad_input, {.where = path.string(),
                                     .field = std::move(field),
                                     .found = std::move(found),
                                     .allowed = std::move(allowed),
                                     .remedy = std::move(remedy)});
}

void HeaderChecks::refuse(std::string field, std::string found, std::string allowed) const {
  throw bad_image(path_, std::move(field), std::move(found), std::move(allowed),
                  "export the label volume again, or copy the file again");
}

std::array<int, 3> HeaderChecks::size(const std::string& field,
                                      const std::vector<std::int64_t>& sizes,
                                      std::int64_t layers) const {
  if (sizes.size() < 3) refuse(field, fmt::format("{} axes", sizes.size()), "three axes");
  auto numbers = static_cast<std::uint64_t>(layers);
  for (std::size_t a = 0; a < sizes.size(); ++a) {
    const auto voxels = sizes[a];
    if (a >= 3 && voxels != 1)
      refuse(field, fmt::format("axis {} has {}", a, voxels), "three axes, one number per voxel");
    if (voxels < 1 || static_cast<std::uint64_t>(voxels) > max_numbers ||
        numbers * static_cast<std::uint64_t>(voxels) > max_numbers) {
      refuse(field, fmt::format("dimensions out of range: axis {} has {} voxels", a, voxels),
             fmt::format("1 to {} numbers in all", max_numbers));
    }
    numbers *= static_cast<std::uint64_t>(voxels);
  }
  return {static_cast<int>(sizes[0]), static_cast<int>(sizes[1]), static_cast<int>(sizes[2])};
}

void HeaderChecks::finite(const std::string& field, const std::vector<double>& values) const {
  for (const double value : values)
    if (!std::isfinite(value)) refuse(field, fmt::format("{}", value), "finite numbers");
}

void HeaderChecks::spans_volume(const std::string& field, const std::array<double, 9>& axes) const {
  finite(field, {axes.begin(), axes.end()});
  double lengths = 1.0;
  for (int c = 0; c < 3; ++c) lengths *= std::hypot(axes[c], axes[3 + c], axes[6 + c]);
  const auto& m = axes;
  const double volume = m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) +
                        m[2] * (m[3] * m[7] - m[4] * m[6]);
  if (!(std::abs(volume) > 1e-6 * lengths) || !std::isfinite(lengths))
    refuse(field, "axes that span no volume", "three axes of finite length, not in one plane");
}

std::vector<double> HeaderChecks::numbers(const std::string& field, const std::string& text) const {
  return parse<double>(*this, field, text);
}

std::vector<std::int64_t> HeaderChecks::integers(const std::string& field,
                                                 const std::string& text) const {
  return parse<std::int64_t>(*this, field, text);
}

void check_stored(const HeaderChecks& checks, const StoredData& data) {
  const std::uint64_t size = fs::file_size(data.file);
  std::uint64_t there = size > data.offset ? size - data.offset : 0, promised = data.bytes;
  const auto refuse = [&](const char* what) {
    checks.refuse(data.field,
                  fmt::format("{}: {} bytes where the header promises {}", what, there, promised),
                  "a file that holds what its header says");
  };
  if (data.encoding == Encoding::deflated) {
    // Deflate shrinks to no less than 1/1032: no need to expand what cannot be enough.
    const bool may_be = there >= promised / 1032;
    if (!may_be || !Inflater(data).count(promised, there))
      refuse("truncated or damaged: its data end too early or do not expand");
  }
  if (data.encoding == Encoding::hex) promised = 2 * data.bytes;
  if (data.encoding == Encoding::text) promised = 2 * data.values - 1;
  if (there < promised) refuse("its data end too early");
  const bool exact = data.encoding == Encoding::raw || data.encoding == Encoding::deflated;
  if (exact && !data.ends_file && there > promised + slack) refuse("it holds far more");
}

fs::path detached_file(const HeaderChecks& checks, const std::string& field,
                       const std::string& name) {
  const fs::path given(name);
  const bool climbs = given.is_absolute() ||
                      std::any_of(given.begin(), given.end(), [](auto& p) { return p == ".."; });
  if (climbs || name.empty() || name.find('\0') != std::string::npos)
    checks.refuse(field, fmt::format("'{}'", name), "a file beside the header, or below it");
  const fs::path file = checks.path().parent_path() / given;
  std::error_code failure;  // as of a name longer than the file system takes
  if (!fs::is_regular_file(file, failure))
    checks.refuse(field, fmt::format("'{}' is not there", name), "one file with all voxels");
  return file;
}

const std::string& TextHeader::field(const HeaderChecks& checks, const std::string& name) const {
  const auto found = fields.find(name);
  if (found == fields.end()) checks.refuse(name, "missing", "a header with this field");
  return found->second;
}

bool NoCase::operator()(const std::string& a, const std::string& b) const {
  return std::lexicographical_compare(
      a.begin(), a.end(), b.begin(), b.end(),
      [](unsigned char x, unsigned char y) { return std::tolower(x) < std::tolower(y); });
}

std::string trimmed(const std::string& text) {
  const auto begin = text.find_first_not_of(" \t\r");
  const auto end = text.find_last_not_of(" \t\r");
  return begin == std::string::npos ? "" : text.substr(begin, end - begin + 1);
}

HeaderLines::HeaderLines(const HeaderChecks& checks, std::size_t longest)
    : checks_(checks), file_(checks.path(), std::ios::binary), longest_(longest) {}

std::optional<std::string> HeaderLines::next() {
  std::string line;
  for (int c = file_.get(); c != EOF; c = file_.get()) {
    ++position_;
    if (c == '\n') return line;
    if (c == '\0' || line.size() == longest_ || position_ > max_header) {
      checks_.refuse("header", c == '\0' ? "binary data" : "lines that do not end",
                     fmt::format("lines of text of at most {} characters", longest_));
    }
    line += static_cast<char>(c);
  }
  return line.empty() ? std::nullopt : std::optional(line);
}

ImageHeader read_image_header(const fs::path& path) {
  const HeaderChecks checks(path);
  if (!fs::is_regular_file(path)) {
    throw bad_image(path, "", fs::exists(path) ? "not a file" : "no such file", image_formats,
                    "check the path");
  }
  std::string name = path.filename().string();
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  const auto is = [&name](const char* end) { return name.ends_with(end); };
  if (is(".nii") || is(".nii.gz") || is(".hdr")) return read_nifti_header(checks);
  if (is(".nrrd") || is(".nhdr")) return read_nrrd_header(checks);
  if (is(".mha") || is(".mhd")) return read_meta_header(checks);
  throw bad_image(path, "", "not an image that is known here", image_formats,
                  "convert the volume to one of these formats");
}

}  // namespace viscera
