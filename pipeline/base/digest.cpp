#include "pipeline/base/digest.hpp"

#include <fmt/format.h>
#include <openssl/evp.h>

#include <array>
#include <fstream>
#include <memory>
#include <vector>

#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"

namespace viscera {
namespace {

class Sha256 {
 public:
  Sha256() : context_(EVP_MD_CTX_new(), EVP_MD_CTX_free) {
    if (!context_ || EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr) != 1) {
      throw Error(ExitCode::internal, {.field = "sha256", .found = "OpenSSL refused the digest"});
    }
  }
  void update(const void* bytes, std::size_t size) {
    EVP_DigestUpdate(context_.get(), bytes, size);
  }
  std::string hex() {
    std::array<unsigned char, EVP_MAX_MD_SIZE> raw{};
    unsigned int size = 0;
    EVP_DigestFinal_ex(context_.get(), raw.data(), &size);
    constexpr char digits[] = "0123456789abcdef";
    std::string text;
    for (unsigned int i = 0; i < size; ++i) {
      text += digits[raw[i] >> 4];
      text += digits[raw[i] & 15];
    }
    return text;
  }

 private:
  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context_;
};

}  // namespace

std::string sha256(std::string_view bytes) {
  Sha256 digest;
  digest.update(bytes.data(), bytes.size());
  return digest.hex();
}

std::string sha256_file(const std::filesystem::path& path) {
  std::error_code failure;
  const bool regular = std::filesystem::is_regular_file(path, failure);
  const bool special = !regular && std::filesystem::exists(path, failure);
  std::ifstream file;
  if (regular) file.open(path, std::ios::binary);  // opening a pipe would wait for its writer
  if (!file.is_open()) {
    throw Error(ExitCode::bad_input, {.where = path.string(),
                                      .found = special ? "not a regular file" : "cannot be read",
                                      .allowed = "a readable file",
                                      .remedy = "check the path and its permissions"});
  }
  Sha256 digest;
  std::vector<char> buffer(1 << 20);
  while (file) {
    log::check_interrupt();
    file.read(buffer.data(), static_cast<std::streamsize>(buffer.size()));
    digest.update(buffer.data(), static_cast<std::size_t>(file.gcount()));
  }
  return digest.hex();
}

void KeyTranscript::add(std::string_view type, std::string_view name, std::string_view value) {
  // The length keeps a value with line breaks from imitating another component.
  text_ += fmt::format("{} {} = [{}] {}\n", type, name, value.size(), value);
}

}  // namespace viscera
