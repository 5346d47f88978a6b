// Whether a type is one of others.
#pragma once

#include <type_traits>

namespace viscera::sim {

template <class One, class... Others>
inline constexpr bool is_any_of = (std::is_same_v<One, Others> || ...);

}  // namespace viscera::sim
