// A walk over the elements of a DICOM file before DCMTK reads it: DCMTK descends into sequences by
// recursion, without a bound, and takes lengths as they come.
#pragma once

#include <cstdint>
#include <filesystem>

namespace viscera {

// Elements from byte `begin` to the end of the file. Throws Error(bad_input) naming
// the file for lengths that reach beyond what encloses them, and for more than 32 nested items.
void check_elements(const std::filesystem::path& path, std::uint64_t begin, bool explicit_vr,
                    bool big_endian);

}  // namespace viscera
