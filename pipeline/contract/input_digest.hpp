// The digest of an input as its reader sees it: not the named file alone, but every file that the
// reader opens because of it. Engine and stages share this definition, so that what a key promises
// can be compared with what a stage read.
//
//   a file                       its SHA-256
//   an image with detached data  header and data files: NRRD "data file:", MetaImage
//                                "ElementDataFile", both told by content; NIfTI .hdr with .img
//   a folder                     every regular file below it, with its relative name
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "pipeline/base/digest.hpp"
#include "pipeline/contract/manifest.hpp"

namespace viscera {

using FileHasher = std::function<std::string(const std::filesystem::path&)>;

// Files that `header` names for its pixels and that exist, in the order named; those of a numbered
// pattern ("slice%03d.raw 1 9 1") are all files beside it that the pattern could mean. Empty for a
// file that holds its own data. A named file that is missing is left to the reader to refuse.
std::vector<std::filesystem::path> detached_data(const std::filesystem::path& header);

// `hash` may remember what it has read before. Throws Error(bad_input) for what is neither a
// regular file nor a folder (a device would never end), and for what cannot be read.
FileDigest input_digest(const std::filesystem::path& path, const FileHasher& hash = sha256_file);

}  // namespace viscera
