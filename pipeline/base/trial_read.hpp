// Debian's VTK 9.1, gmsh 4.8 and HDF5 1.10 crash on some damaged files, write outside their arrays
// or read without end on others, and believe any number of points or cells that a header claims. A
// process of its own reads such a file without harm to this one.
#pragma once

#include <filesystem>
#include <functional>
#include <string>

namespace viscera {

struct ChildReading {
  std::string broken;  // what is wrong with the file, "" for nothing
  std::string result;  // what `read` returned: any bytes; empty where the file is broken
};

// Runs `read` in a copy of this process that may take 1 GB and 200 times the file's size (zlib
// packs what we write at most 20 times) more memory than this one has, and `max_seconds` of a
// processor besides one for each MB of the file (it takes a tenth of that), and hands over what it
// returns. An Error that it throws is thrown here, and another exception as a std::runtime_error of
// its message. The copy has none of this process's other threads, so `read` must wait for none.
ChildReading read_in_child(const std::filesystem::path& path,
                           const std::function<std::string()>& read, int max_seconds = 60);

// The same for a file too large to be handed over, which is read a second time, in this process,
// where the first reading bears it: what `read` throws is left to the second reading.
std::string what_breaks_reading(const std::filesystem::path& path,
                                const std::function<void()>& read);

}  // namespace viscera
