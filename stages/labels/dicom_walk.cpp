#include "stages/labels/dicom_walk.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <string_view>
#include <vector>

#include "stages/image/image_header.hpp"

namespace viscera {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t max_depth = 64;  // sequences and items, two a level
constexpr std::uint32_t undefined = 0xffffffff, item = 0xfffee000, item_end = 0xfffee00d,
                        sequence_end = 0xfffee0dd, pixel_data = 0x7fe00010;

class Walk {
 public:
  Walk(const fs::path& path, std::uint64_t begin, bool explicit_vr, bool big_endian)
      : path_(path),
        file_(path, std::ios::binary),
        at_(begin),
        explicit_(explicit_vr),
        big_endian_(big_endian) {
    ends_.push_back(fs::file_size(path));
    file_.seekg(static_cast<std::streamoff>(begin));
  }

  void run() {
    while (!ends_.empty()) {
      if (at_ >= ends_.back()) {
        ends_.pop_back();
      } else {
        element();
      }
    }
  }

 private:
  [[noreturn]] void refuse(std::uint32_t tag, const std::string& found) const {
    throw bad_image(path_, fmt::format("element ({:04x},{:04x})", tag >> 16, tag & 0xffff), found,
                    "elements that end where they say, at most 32 deep", "copy the file again");
  }

  std::uint32_t number(int bytes) {
    std::array<unsigned char, 4> raw{};
    file_.read(reinterpret_cast<char*>(raw.data()), bytes);
    at_ += static_cast<std::uint64_t>(bytes);
    if (big_endian_) std::reverse(raw.begin(), raw.begin() + bytes);
    return raw[0] | raw[1] << 8 | raw[2] << 16 | std::uint32_t{raw[3]} << 24;
  }

  // Whether a value of this element is made of items; sets its length.
  bool holds_items(std::uint32_t& length) {
    std::array<char, 2> vr{};
    if (explicit_) {
      file_.read(vr.data(), 2);
      at_ += 2;
      constexpr std::string_view wide = "OB OD OF OL OV OW SQ SV UC UN UR UT UV";
      const std::string_view name(vr.data(), 2);
      if (wide.find(name) == std::string_view::npos) {
        length = number(2);
        return false;
      }
      number(2);
      length = number(4);
      if (name == "SQ") return true;
    } else {
      length = number(4);
    }
    if (length == undefined) return true;
    // Without a representation the first bytes tell: those of an item.
    const auto here = at_;
    const bool items = length >= 8 && (!explicit_ || vr[0] == 'U') && tag() == item;
    at_ = here;
    file_.seekg(static_cast<std::streamoff>(at_));
    return items;
  }

  std::uint32_t tag() {
    const std::uint32_t group = number(2);
    return group << 16 | number(2);
  }

  void element() {
    const std::uint32_t own = tag();
    std::uint32_t length = 0;
    const bool delimiter = own == item_end || own == sequence_end;
    const bool nested = own == item ? (length = number(4), true)
                        : delimiter ? (number(4), false)
                                    : holds_items(length);
    if (!file_) refuse(own, "the file ends within it");
    if (delimiter) {
      if (ends_.size() > 1) ends_.pop_back();
      fragments_ = false;
      return;
    }
    const std::uint64_t end = length == undefined ? ends_.back() : at_ + length;
    if (end > ends_.back())
      refuse(own, fmt::format("length {} where {} bytes are left", length, ends_.back() - at_));
    if (!nested || (fragments_ && own == item)) {
      if (length == undefined) refuse(own, "a piece of compressed pixels without a length");
      at_ = end;
      file_.seekg(static_cast<std::streamoff>(at_));
      return;
    }
    if (ends_.size() > max_depth) refuse(own, "sequences nested too deep");
    ends_.push_back(end);
    fragments_ = own == pixel_data;
  }

  const fs::path& path_;
  std::ifstream file_;
  std::uint64_t at_;
  bool explicit_, big_endian_;
  bool fragments_ = false;           // within compressed pixels, whose items hold no elements
  std::vector<std::uint64_t> ends_;  // of the file and of all open sequences and items
};

}  // namespace

void check_elements(const fs::path& path, std::uint64_t begin, bool explicit_vr, bool big_endian) {
  Walk(path, begin, explicit_vr, big_endian).run();
}

}  // namespace viscera
