// Scenes with random damage from a fixed seed: reading must return a scene or throw a typed error. The same test runs
// under the sanitizers, which find invalid memory accesses. Messages are damaged by tests/fuzz/frames.cpp.
#include <gtest/gtest.h>

#include <random>
#include <string>
#include <string_view>

#include "hydro_stub/scene.hpp"
#include "proto/scene/scene.hpp"
#include "tests/support/wire_samples.hpp"

namespace shearbus::wire {
namespace {

// Applies one to four small damages: flipped bits, a cut, signs and pieces that are inserted, pieces that are missing.
std::string damaged(std::string text, const std::string& donor, std::mt19937_64& random) {
  static constexpr std::string_view kSigns = {"\0\1\x7F\x80\xFF[\".=\n{e-", 13};
  const auto below = [&](std::size_t n) { return n == 0 ? 0 : random() % n; };
  for (std::size_t times = 1 + below(4); times > 0; --times) {
    const std::size_t at = below(text.size() + 1);
    switch (below(5)) {
      case 0:
        if (at < text.size()) text[at] = static_cast<char>(text[at] ^ 1 << below(8));
        break;
      case 1:
        text.resize(at);
        break;
      case 2:
        text.insert(at, 1 + below(12), kSigns[below(kSigns.size())]);
        break;
      case 3:
        text.erase(at, 1 + below(12));
        break;
      default:
        text.insert(at, donor, below(donor.size() + 1), 1 + below(24));
    }
  }
  return text;
}

TEST(Mutations, DamagedScenesEndInASceneOrInLinesThatPointIntoTheFile) {
  const std::string problem =
      "[hydro]\nend_time_s = 1e-6\n[hydro.shear_column]\nlength_m = 1e-3\nzones = 100\n"
      "velocity_jump_m_per_s = [1.0, 2.5]\npressure_pa = [1e9, 2e9, 3e9]\npressure_time_s = [0.0, 1e-9, 2e-9]\n";
  const std::string valid[] = {scene::to_toml(scene::parse(samples::kScene, "scene.toml").scene),
                               scene::to_toml(hydro::parse_scene(samples::kScene + problem, "guest.toml").scene)};
  std::mt19937_64 random(3);
  std::size_t taken = 0, refused = 0;
  for (std::size_t i = 0; i < 40'000; ++i) {
    hydro::SceneFile file;
    try {
      file = hydro::parse_scene(damaged(valid[i % 2], valid[random() % 2], random), "m.toml");
    } catch (const Error& error) {
      ++refused;
      EXPECT_EQ(error.status().code, Code::kInvalidScene);
      EXPECT_TRUE(error.status().text.starts_with("m.toml:")) << error.status().text;
      continue;
    }
    ++taken;
    const std::string again = scene::to_toml(file.scene);
    EXPECT_EQ(scene::to_toml(hydro::parse_scene(again, "again.toml").scene), again);
  }
  EXPECT_GT(refused, 10'000U);
  EXPECT_GT(taken, 1'000U);
}

}  // namespace
}  // namespace shearbus::wire
