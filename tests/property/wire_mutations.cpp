// Scenes with random damage from a fixed seed: reading must return a scene or throw a typed error. The same test runs
// under the sanitizers, which find invalid memory accesses. Messages are damaged by tests/fuzz/frames.cpp.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <iterator>
#include <random>
#include <string>
#include <vector>

#include "hydro_stub/scene.hpp"
#include "proto/scene/scene.hpp"
#include "tests/support/wire_samples.hpp"

namespace shearbus::wire {
namespace {

using samples::Bytes;

class Mutator {
 public:
  explicit Mutator(std::uint64_t seed) : random_(seed) {}

  std::size_t below(std::size_t n) { return n == 0 ? 0 : random_() % n; }

  // Applies one to four small damages of kinds that networks, disks and attackers cause.
  void damage(Bytes& bytes, const Bytes& donor) {
    for (std::size_t times = 1 + below(4); times > 0; --times) damage_once(bytes, donor);
  }

 private:
  void damage_once(Bytes& bytes, const Bytes& donor) {
    const std::size_t at = below(bytes.size() + 1);
    switch (below(8)) {
      case 0:
        if (!bytes.empty()) bytes[below(bytes.size())] ^= std::byte(1U << below(8));
        break;
      case 1:
        if (!bytes.empty()) bytes[below(bytes.size())] = interesting();
        break;
      case 2:
        bytes.resize(at);
        break;
      case 3:
        insert(bytes, at, Bytes(1 + below(12), interesting()));
        break;
      case 4: {
        const auto first = bytes.begin() + static_cast<std::ptrdiff_t>(at);
        bytes.erase(first, first + static_cast<std::ptrdiff_t>(std::min(bytes.size() - at, 1 + below(12))));
        break;
      }
      case 5:
        insert(bytes, at, piece(donor, below(donor.size() + 1)));
        break;  // case 5 inserts a piece of another message
      case 6:
        insert(bytes, at, piece(bytes, at));
        break;  // case 6 repeats a piece of the message
      default:  // writes a random 8-byte number over a size, an offset or a double
        if (bytes.size() >= 8) {
          const std::uint64_t number = below(2) == 0 ? random_() : ~std::uint64_t{0} >> below(64);
          std::memcpy(bytes.data() + below(bytes.size() - 7), &number, sizeof number);
        }
    }
  }

  Bytes piece(const Bytes& from, std::size_t at) {
    const auto first = from.begin() + static_cast<std::ptrdiff_t>(at);
    return {first, first + static_cast<std::ptrdiff_t>(std::min(from.size() - at, 1 + below(24)))};
  }

  static void insert(Bytes& bytes, std::size_t at, const Bytes& more) {
    bytes.insert(bytes.begin() + static_cast<std::ptrdiff_t>(at), more.begin(), more.end());
  }

  std::byte interesting() {
    static constexpr unsigned char kBytes[] = {0x00, 0x01, 0x7F, 0x80, 0xFF, 0x08, 0x0A, 0x42,
                                               '[',  '"',  '.',  '=',  '\n', '{',  'e',  '-'};
    return below(2) == 0 ? std::byte(kBytes[below(std::size(kBytes))]) : std::byte(below(256));
  }

  std::mt19937_64 random_;
};

TEST(Mutations, DamagedScenesEndInASceneOrInLinesThatPointIntoTheFile) {
  const std::string problem =
      "[hydro]\nend_time_s = 1e-6\n[hydro.shear_column]\nlength_m = 1e-3\nzones = 100\n"
      "velocity_jump_m_per_s = [1.0, 2.5]\npressure_pa = [1e9, 2e9, 3e9]\npressure_time_s = [0.0, 1e-9, 2e-9]\n";
  const std::vector<Bytes> valid = {
      samples::to_bytes(scene::to_toml(scene::parse(samples::kScene, "scene.toml").scene)),
      samples::to_bytes(scene::to_toml(hydro::parse_scene(samples::kScene + problem, "guest.toml").scene))};
  Mutator mutator(3);
  std::size_t taken = 0, refused = 0;
  for (std::size_t i = 0; i < 40'000; ++i) {
    Bytes bytes = valid[mutator.below(valid.size())];
    mutator.damage(bytes, valid[mutator.below(valid.size())]);
    hydro::SceneFile file;
    try {
      file = hydro::parse_scene(std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size()), "m.toml");
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
