// The flow laws (flow_law_list.hpp) at points of a layer.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "server/physics/material/elementary.hpp"
#include "server/physics/material/flow_law.hpp"
#include "server/physics/material/law_list.hpp"

namespace shearbus::physics {

template <class... Laws>
using FlowLawList = LawList<FlowLaw, Laws...>;

#if defined(__clang__)
#pragma clang diagnostic push
#pragma clang diagnostic ignored "-Wbitwise-instead-of-logical"  // the masks of one lane are of type bool
#endif
inline namespace point {
#include "server/physics/material/flow_law_list.hpp"
}  // namespace point
#if defined(__clang__)
#pragma clang diagnostic pop
#endif

template <class... Laws>
constexpr bool are_flow_laws(FlowLawList<Laws...>) {
  return (FlowLawClass<Laws> && ...);
}
static_assert(are_flow_laws(FlowLaws{}));

// Whether the constant of Material belongs to this law.
inline bool has_constant(FlowLaw law, double Material::*constant) {
  return FlowLaws::with(law, [&](auto own) {
    const auto& constants = decltype(own)::type::kConstants;
    return std::find(constants.begin(), constants.end(), constant) != constants.end();
  });
}

// Whether the strain increment of a vertex is an explicit function of the stress.
inline bool has_explicit_flow(FlowLaw law) {
  return FlowLaws::with(law, [](auto own) { return ExplicitFlow<typename decltype(own)::type>; });
}

inline FlowLawProperties properties_of(FlowLaw law) {
  return FlowLaws::with(law, [](auto own) { return properties_of_law<typename decltype(own)::type>(); });
}

}  // namespace shearbus::physics
