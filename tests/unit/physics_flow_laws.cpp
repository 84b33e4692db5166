// Every flow law must declare its properties. A class that lacks a declaration does not satisfy the concept
// FlowLawClass.
#include "server/physics/material/flow_laws.hpp"

#include <gtest/gtest.h>

namespace shearbus::physics {
namespace {

static_assert(FlowLawClass<SteinbergCochranGuinan>);
static_assert(FlowLawClass<JohnsonCook>);

// Two classes that are no flow laws: one declares no properties, the other hides one of its properties.
struct Undeclared {
  [[maybe_unused]] static constexpr std::string_view kName = "undeclared";
};
template <class Law>
struct WithoutRate : Law {
 private:
  static constexpr bool kDependsOnRate = false;
};
static_assert(!DeclaresFlowLawProperties<Undeclared>);
static_assert(!FlowLawClass<WithoutRate<SteinbergCochranGuinan>>);

// A class that declares all properties and yet is no flow law: its strength does not vanish at melting.
struct Undying : SteinbergCochranGuinan {
  using SteinbergCochranGuinan::SteinbergCochranGuinan;
  static constexpr bool kVanishesAtMelting = false;
};
static_assert(DeclaresFlowLawProperties<Undying>);
static_assert(!FlowLawClass<Undying>);

TEST(PhysicsFlowLaws, PropertiesAreThoseOfTheClasses) {
  const FlowLawProperties steinberg = properties_of(FlowLaws::place<SteinbergCochranGuinan>());
  EXPECT_FALSE(steinberg.depends_on_rate);
  EXPECT_FALSE(steinberg.first_order_in_time);
  EXPECT_TRUE(steinberg.has_pressure_term);
  EXPECT_TRUE(steinberg.has_ceiling);
  EXPECT_TRUE(steinberg.has_wave_return);
  const FlowLawProperties johnson_cook = properties_of(FlowLaws::place<JohnsonCook>());
  EXPECT_TRUE(johnson_cook.depends_on_rate);
  EXPECT_TRUE(johnson_cook.first_order_in_time);
  EXPECT_FALSE(johnson_cook.has_pressure_term);
  EXPECT_FALSE(johnson_cook.has_ceiling);
  EXPECT_FALSE(johnson_cook.has_wave_return);
}

TEST(PhysicsFlowLaws, AConstantBelongsToTheLawsThatListIt) {
  const FlowLaw steinberg = FlowLaws::place<SteinbergCochranGuinan>(), johnson_cook = FlowLaws::place<JohnsonCook>();
  EXPECT_TRUE(has_constant(steinberg, &Material::hardening_coefficient));
  EXPECT_FALSE(has_constant(johnson_cook, &Material::hardening_coefficient));
  EXPECT_TRUE(has_constant(steinberg, &Material::hardening_exponent));
  EXPECT_TRUE(has_constant(johnson_cook, &Material::hardening_exponent));
  EXPECT_FALSE(has_constant(steinberg, &Material::density));
}

}  // namespace
}  // namespace shearbus::physics
