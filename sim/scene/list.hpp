// The registry: every effect there is, in the order in which a substep applies those of one kind.
#pragma once

#include <tuple>
#include <vector>

#include "sim/effects/attachments.hpp"
#include "sim/effects/colliders.hpp"
#include "sim/effects/distance.hpp"
#include "sim/effects/gravity.hpp"
#include "sim/effects/grip.hpp"
#include "sim/effects/ground.hpp"
#include "sim/effects/laws/corotational.hpp"
#include "sim/effects/laws/fibre.hpp"
#include "sim/effects/laws/grouped_volume.hpp"
#include "sim/effects/laws/linear.hpp"
#include "sim/effects/laws/mooney_rivlin.hpp"
#include "sim/effects/laws/neo_hookean.hpp"
#include "sim/effects/laws/ogden.hpp"
#include "sim/effects/laws/prony.hpp"
#include "sim/effects/laws/shape_matching.hpp"
#include "sim/effects/laws/smoothed.hpp"
#include "sim/effects/laws/stvk.hpp"
#include "sim/effects/laws/viscosity.hpp"
#include "sim/effects/laws/volume.hpp"
#include "sim/effects/load.hpp"
#include "sim/effects/pressure.hpp"
#include "sim/effects/self_contact.hpp"
#include "sim/effects/spring.hpp"

namespace viscera::sim {

template <class... All>
struct EffectList {
  static_assert((StatesItsEnd<All> && ...),
                "an effect of the list has no static double ends(const Params&): see effect.hpp");

  // What a scene names: parameters of the effects that are on. An effect may be named several times
  // (two springs, three colliders).
  using Choice = std::tuple<std::vector<typename All::Params>...>;
  // `Data<Effect>` for every time that the effect is named: none for those that are off.
  template <template <class> class Data>
  using Slots = std::tuple<std::vector<Data<All>>...>;

  // A base `Part<Effect>` for every effect.
  template <template <class> class Part>
  struct Joined : Part<All>... {};

  static constexpr std::size_t size = sizeof...(All);

  template <class Effect>
  static constexpr std::size_t index_of() {
    constexpr bool is_it[] = {std::is_same_v<Effect, All>...};
    std::size_t index = 0;
    while (!is_it[index]) ++index;
    return index;
  }

  // function.template operator()<Effect, index>() for every effect in order.
  template <class Function>
  static constexpr void for_each(Function&& function) {
    [&]<std::size_t... i>(std::index_sequence<i...>) {
      (function.template operator()<All, i>(), ...);
    }
    (std::index_sequence_for<All...>{});
  }
};

using Effects =
    EffectList<Gravity, Grip, Fixed, Prescribed, Viscosity, Pressure, Load, NeoHookean,
               SmoothedNeoHookean, SmoothedMooneyRivlin, SmoothedOgden, SmoothedLinear,
               SmoothedStVK, GroupedVolume, MooneyRivlin, Ogden, Linear, StVK, Corotational,
               Distance, Volume, Fibre, Prony, Spring, ShapeMatching, SelfContact, Ground,
               Collider<Plane>, Collider<Sphere>, Collider<Capsule>, Collider<Box>>;

}  // namespace viscera::sim
