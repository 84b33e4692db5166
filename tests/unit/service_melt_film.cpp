// Scenes with [melt_film]: their keys, what they refuse, and the column that tells the thickness of the melt.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <variant>
#include <vector>

#include "proto/wire/status.hpp"
#include "server/service/scene_model.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/service_harness.hpp"

namespace shearbus::service {
namespace {

using ::testing::HasSubstr;

const std::vector<std::uint64_t> kNodes = {1, 2, 3};

v1::Scene melting_scene() {
  v1::Scene scene = support::force_scene();
  scene.mutable_hard_layer();
  scene.mutable_melt_film()->set_latent_heat_j_per_kg(397e3);
  scene.mutable_melt_film()->set_viscosity_pa_s(1.25e-3);
  return scene;
}

wire::Status refusal_of(const v1::Scene& scene) {
  return support::fault_of([&] { scene_model(scene); });
}

TEST(MeltFilmScene, HasItsConstantsAndKeepsThem) {
  const SceneModel made = scene_model(melting_scene());
  ASSERT_TRUE(made.options.melt_film);
  EXPECT_EQ(made.options.melt_film->latent_heat, 397e3);
  EXPECT_EQ(made.options.melt_film->viscosity, 1.25e-3);
  EXPECT_EQ(made.options.melt_film->activation_energy, 0.0);
  EXPECT_EQ(scene_model(made.effective, "effective").effective, made.effective);
  EXPECT_THAT(made.effective, HasSubstr("activation_energy_j_per_mol = 0"));
}

TEST(MeltFilmScene, RefusesWhatItCannotDo) {
  v1::Scene scene = melting_scene();
  scene.mutable_melt_film()->clear_viscosity_pa_s();
  EXPECT_EQ(refusal_of(scene).field, "melt_film");
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("viscosity_pa_s"));
  scene = melting_scene();
  scene.clear_hard_layer();
  EXPECT_EQ(refusal_of(scene).field, "melt_film");
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("[hard_layer]"));
  scene = melting_scene();
  scene.mutable_interface()->set_plastic_layer(true);
  EXPECT_THAT(refusal_of(scene).text, HasSubstr("before the interface melts"));
}

TEST(MeltFilmColumn, IsAnsweredWhereItIsAskedForAndRefusedInOtherScenes) {
  ServiceHarness harness, plain;
  ASSERT_TRUE(harness.ask(ServiceHarness::opening(melting_scene(), kNodes)).reply.status.ok());
  ASSERT_TRUE(plain.ask(ServiceHarness::opening(support::force_scene(), kNodes)).reply.status.ok());
  wire::Request step = ServiceHarness::step(1, support::step_columns(wire::Strategy::kForceDriven, kNodes, 1, true));
  std::get<wire::Downscale>(step.body).wanted = {Field::kFilmThickness};
  const Answer answer = harness.ask(step);
  ASSERT_TRUE(answer.reply.status.ok()) << answer.reply.status.text;
  EXPECT_TRUE(std::ranges::all_of(answer.reply.batch.f64(Field::kFilmThickness), [](double x) { return x == 0.0; }));
  const Answer refused = plain.ask(step);
  EXPECT_EQ(refused.code(), Code::kUnsupported);
  EXPECT_THAT(refused.reply.status.text, HasSubstr("nothing melts"));
  step.sequence = 2;
  std::get<wire::Downscale>(step.body).wanted = {Field::kStressPerJump};
  EXPECT_EQ(harness.ask(step).code(), Code::kUnsupported);
}

}  // namespace
}  // namespace shearbus::service
