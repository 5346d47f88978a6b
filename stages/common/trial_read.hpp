// Debian's VTK 9.1 and HDF5 1.10 crash on some damaged files, and believe any number of points or
// cells that a header claims. A first reading in a process of its own finds out without harm.
#pragma once

#include <filesystem>
#include <functional>
#include <string>

namespace viscera {

// Runs `read` in a copy of this process that may take 1 GB and 200 times the file's size (zlib
// packs what we write at most 20 times) more than this one has. What is wrong with the file, "" for
// nothing: complaints of the reader itself are left to the second reading.
std::string what_breaks_reading(const std::filesystem::path& path,
                                const std::function<void()>& read);

}  // namespace viscera
