#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "proto/wire/limits.hpp"
#include "proto/wire/scene_file.hpp"
#include "proto/wire/text.hpp"
#include "shearbus_places.hpp"
#include "tests/support/wire_samples.hpp"

namespace shearbus::wire {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

// The scene every example starts from.
constexpr const char* kPaper = R"(name = "paper_velocity_driven"
strategy = "velocity_driven"            # or "force_driven"
[soft]
material = "aluminium_dlp"
[hard]
material = "steel_dlp"
[layer]
thickness_m = 20e-6
cells = 500
grading = 1.0
far_boundary = "insulated"              # or "half_space"
initial_temperature_k = 300.0
[velocity_driven]
drive = "layer_shear"                   # or "interface_slip"
[interface]                             # force-driven
friction_coefficient = 0.3
yield_strength_pa = 200e6
)";

std::string refusal_of(const std::string& toml) {
  try {
    parse_scene(toml, "scene.toml");
  } catch (const Error& error) {
    EXPECT_EQ(error.status().code, Code::kInvalidScene);
    return error.status().text;
  }
  return "";
}

std::string load_refusal(const std::filesystem::path& path) {
  try {
    load_scene_file(path);
  } catch (const Error& error) {
    return error.status().text;
  }
  return "";
}

TEST(SceneFile, ThePapersSceneLoadsAsWritten) {
  const SceneFile file = parse_scene(kPaper, "paper.toml");
  const Scene& scene = file.scene;
  EXPECT_EQ(scene.name, "paper_velocity_driven");
  EXPECT_EQ(scene.source, "");
  EXPECT_EQ(scene.strategy, Strategy::kVelocityDriven);
  EXPECT_EQ(scene.soft.material, "aluminium_dlp");
  EXPECT_TRUE(scene.soft.given.empty());
  EXPECT_EQ(scene.hard.material, "steel_dlp");
  EXPECT_EQ(scene.layer.thickness_m, 20e-6);
  EXPECT_EQ(scene.layer.cells, 500U);
  EXPECT_EQ(scene.layer.grading, 1.0);
  EXPECT_EQ(scene.layer.far_boundary, FarBoundary::kInsulated);
  EXPECT_EQ(scene.layer.initial_temperature_k, 300.0);
  EXPECT_EQ(scene.velocity_driven.drive, Drive::kLayerShear);
  EXPECT_FALSE(scene.velocity_driven.friction_coefficient);
  ASSERT_TRUE(scene.interface);
  EXPECT_EQ(scene.interface->friction_coefficient, 0.3);
  EXPECT_EQ(scene.interface->yield_strength_pa, 200e6);
  EXPECT_FALSE(scene.hydro);
  EXPECT_TRUE(check_scene(scene).ok());
}

TEST(SceneFile, AbsentKeysTakeTheirDefaults) {
  const Scene scene =
      parse_scene("name='x'\nstrategy='velocity_driven'\nsoft.material='a'\nhard.material='b'\n", "s").scene;
  const Scene plain;
  EXPECT_EQ(scene.layer.thickness_m, plain.layer.thickness_m);
  EXPECT_EQ(scene.layer.cells, plain.layer.cells);
  EXPECT_EQ(scene.layer.grading, plain.layer.grading);
  EXPECT_EQ(scene.layer.far_boundary, plain.layer.far_boundary);
  EXPECT_EQ(scene.layer.initial_temperature_k, plain.layer.initial_temperature_k);
  EXPECT_EQ(scene.velocity_driven.drive, plain.velocity_driven.drive);
  EXPECT_FALSE(scene.velocity_driven.friction_coefficient);
  EXPECT_FALSE(scene.interface);
}

TEST(SceneFile, GuestDefaultsAreTheSameInSchemaAndStruct) {
  const Scene scene = parse_scene(std::string(kPaper) + "[hydro]\nend_time_s = 1e-6\n", "s").scene;
  ASSERT_TRUE(scene.hydro);
  const Hydro plain;
  EXPECT_EQ(scene.hydro->interface_law, plain.interface_law);
  EXPECT_EQ(scene.hydro->cfl, plain.cfl);
  EXPECT_FALSE(scene.hydro->dt_s);
  EXPECT_FALSE(scene.hydro->shear_column);
  EXPECT_EQ(scene.hydro->coulomb_tresca.friction_coefficient_at_rest,
            plain.coulomb_tresca.friction_coefficient_at_rest);
  EXPECT_EQ(scene.hydro->coulomb_tresca.friction_coefficient_fast, plain.coulomb_tresca.friction_coefficient_fast);
  EXPECT_EQ(scene.hydro->coulomb_tresca.velocity_decay_s_per_m, plain.coulomb_tresca.velocity_decay_s_per_m);
  EXPECT_EQ(scene.hydro->coulomb_tresca.yield_fraction, plain.coulomb_tresca.yield_fraction);
}

TEST(SceneFile, ConstantsGivenOverrideByName) {
  const Scene scene = parse_scene(
                          "name='x'\nstrategy='velocity_driven'\nhard.material='b'\n[soft]\nmaterial='a'\nmelting_"
                          "temperature_k = 1743\n"
                          "yield_strength_pa = 2.1e8\n",
                          "s")
                          .scene;
  EXPECT_THAT(scene.soft.given, ElementsAre(std::pair<std::string, double>("yield_strength_pa", 2.1e8),
                                            std::pair<std::string, double>("melting_temperature_k", 1743.0)));
}

TEST(SceneFile, AScalarStandsForAListOfOne) {
  const Scene scene = parse_scene(std::string(kPaper) +
                                      "[hydro]\nend_time_s=1e-6\n[hydro.shear_column]\nlength_m=1e-3\nzones=100\n"
                                      "velocity_jump_m_per_s=100\npressure_pa=[1e9, 2_000_000_000]\n",
                                  "s")
                          .scene;
  EXPECT_THAT(scene.hydro->shear_column->velocity_jump_m_per_s, ElementsAre(100.0));
  EXPECT_THAT(scene.hydro->shear_column->pressure_pa, ElementsAre(1e9, 2e9));
}

TEST(SceneFile, ABooleanIsTrueOrFalse) {
  const std::string toml =
      "name='x'\nstrategy='force_driven'\nsoft.material='a'\nhard.material='b'\n"
      "[interface]\nfriction_coefficient = 0.3\nyield_strength_pa = 2e8\n";
  EXPECT_FALSE(parse_scene(toml, "s").scene.interface->plastic_layer);
  const Scene scene = parse_scene(toml + "plastic_layer = true\n", "s").scene;
  EXPECT_TRUE(scene.interface->plastic_layer);
  EXPECT_TRUE(parse_scene(scene_to_toml(scene), "again").scene.interface->plastic_layer);
  EXPECT_THROW(parse_scene(toml + "plastic_layer = 1\n", "s"), Error);
}

TEST(SceneFile, PlacesPointIntoTheFile) {
  const SceneFile file = parse_scene(kPaper, "paper.toml");
  EXPECT_EQ(file.where("layer.cells"), "paper.toml:9:1");
  EXPECT_EQ(file.where("soft.yield_strength_pa"), "paper.toml:3:1");  // absent: its table
  EXPECT_EQ(file.where("strategy"), "paper.toml:2:1");
  EXPECT_EQ(file.where("layer.cells[3]"), "paper.toml:9:1");
  EXPECT_EQ(file.where("nowhere"), "paper.toml");
  EXPECT_EQ(file.where(""), "paper.toml");
}

// tests/golden/wire/scene_faults.txt: blocks of "=== title", a TOML text, "---", and the lines the loader must answer
// with.
TEST(SceneFile, EveryFaultIsToldWithItsPlace) {
  std::ifstream golden(std::string(SHEARBUS_SOURCE_DIR) + "/tests/golden/wire/scene_faults.txt");
  ASSERT_TRUE(golden);
  std::string line, title, toml, expected;
  bool in_answer = false;
  int blocks = 0;
  const auto check = [&] {
    if (title.empty()) return;
    ++blocks;
    SCOPED_TRACE(title);
    EXPECT_FALSE(expected.empty());
    EXPECT_EQ(refusal_of(toml) + "\n", expected);
  };
  while (std::getline(golden, line)) {
    if (line.starts_with("=== ")) {
      check();
      title = line.substr(4);
      toml.clear(), expected.clear();
      in_answer = false;
    } else if (line == "---") {
      in_answer = true;
    } else {
      (in_answer ? expected : toml) += line + "\n";
    }
  }
  check();
  EXPECT_GE(blocks, 30);
}

TEST(SceneFile, WhatIsNoSceneFileIsRefused) {
  const auto directory = std::filesystem::path(testing::TempDir()) / "wire_scene_files";
  std::filesystem::create_directories(directory);
  EXPECT_THAT(load_refusal(directory), HasSubstr("is a directory, expected a scene file"));
  EXPECT_THAT(load_refusal(directory / "absent.toml"),
              HasSubstr("absent.toml: cannot be opened: No such file or directory"));
  const auto with = [&](const char* name, const std::string& text) {
    std::ofstream(directory / name, std::ios::binary) << text;
    return load_refusal(directory / name);
  };
  EXPECT_THAT(with("empty.toml", ""), HasSubstr("empty.toml:1:1: the file is empty, expected a scene"));
  std::mt19937_64 random(5);
  std::string rubbish(4096, '\0');
  for (char& c : rubbish) c = static_cast<char>(random());
  EXPECT_THAT(with("rubbish.bin", rubbish), HasSubstr("rubbish.bin:1:"));
  EXPECT_THAT(with("zeros.bin", std::string(64, '\0')), HasSubstr("zeros.bin:1:1:"));
  EXPECT_THAT(with("large.toml", std::string(kMaxSceneFileBytes + 1, ' ')), HasSubstr("larger than 8388608 bytes"));
  EXPECT_EQ(with("good.toml", kPaper), "");
  std::filesystem::remove_all(directory);
}

// toml++ takes tables down recursively: a line of many dots would overflow the stack.
TEST(SceneFile, DepthIsRefusedBeforeItIsBuilt) {
  std::string key = "a";
  for (int i = 0; i < 200'000; ++i) key += ".a";
  EXPECT_THAT(refusal_of(key + " = 1\n"), HasSubstr("a key of too many parts"));
  EXPECT_THAT(refusal_of("\n[" + key + "]\n"), StartsWith("scene.toml:2:"));
  EXPECT_THAT(refusal_of("x = 'a # b'\ny = {" + key + " = 1}\n"), HasSubstr("a key of too many parts"));
  EXPECT_THAT(refusal_of("x = \"\"\"\n a . b \\\"\"\" \n\"\"\"\n" + key + " = 1\n"),
              StartsWith("scene.toml:4:18: a key of"));
  EXPECT_THAT(refusal_of("y = {x = \"\"\"a\"\"\"\"\", " + key + " = 1}\n"), HasSubstr("a key of too many parts"));
  EXPECT_THAT(refusal_of("y = {x = '''a'''', " + key + " = 1}\n"), HasSubstr("a key of too many parts"));
  EXPECT_THAT(refusal_of("x = " + std::string(100'000, '[')), HasSubstr("nested"));
  std::string tables;
  for (int i = 0; i < 100'000; ++i) tables += "{a.a.a.a.a.a=";
  EXPECT_THAT(refusal_of("x = " + tables), HasSubstr("nested"));
  EXPECT_EQ(refusal_of("source = 'a.b.c.d.e.f.g.h.i.j.k.l'  # ............\n" + std::string(kPaper)), "");
}

// ---- round trip ----

class RandomScene {
 public:
  explicit RandomScene(std::uint64_t seed) : random_(seed) {}

  Scene draw() {
    Scene scene;
    scene.name = "s" + text();
    scene.source = text();
    scene.strategy = flip() ? Strategy::kVelocityDriven : Strategy::kForceDriven;
    scene.soft = body();
    scene.hard = body();
    if (flip()) scene.soft.melting_curve = MeltingCurve::kLindemann;
    if (flip()) scene.soft.pressure_term = PressureTerm::kCompressed;
    scene.layer.thickness_m = number(1e-6, 1e-3);
    scene.layer.cells = 1 + static_cast<std::uint32_t>(random_() % 100);
    scene.layer.grading = number(1.0, 1.05);
    scene.layer.far_boundary = flip() ? FarBoundary::kInsulated : FarBoundary::kHalfSpace;
    scene.layer.initial_temperature_k = number(1e-3, 1e4);
    if (flip()) scene.hard_layer = hard_layer();
    if (scene.strategy == Strategy::kForceDriven && !scene.hard_layer && flip()) {
      scene.layer.heat = Heat::kModes;
      scene.layer.modes = HeatModes{
          .accuracy = number(1e-10, 0.1), .shortest_step_s = number(1e-15, 1e-9), .longest_time_s = number(1e-9, 1e3)};
    }
    scene.velocity_driven.drive = flip() ? Drive::kLayerShear : Drive::kInterfaceSlip;
    if (flip()) scene.velocity_driven.friction_coefficient = number(1e-290, 10);
    if (scene.strategy == Strategy::kVelocityDriven && scene.hard_layer &&
        scene.velocity_driven.drive == Drive::kLayerShear)
      scene.velocity_driven.taylor_quinney_factor = number(1e-3, 1);
    scene.layer.inertia = scene.strategy == Strategy::kVelocityDriven && flip() &&
                          scene.velocity_driven.drive == Drive::kLayerShear &&
                          !scene.velocity_driven.taylor_quinney_factor;
    if (flip() || scene.strategy == Strategy::kForceDriven)
      scene.interface = Interface{.friction_coefficient = number(1e-9, 10), .yield_strength_pa = number(1e-290, 1e12)};
    if (scene.strategy == Strategy::kForceDriven)
      scene.interface->plastic_layer = scene.layer.heat == Heat::kProfile && flip();
    if (scene.strategy == Strategy::kForceDriven && !scene.interface->plastic_layer) scene.junctions = junctions();
    if (!scene.layer.inertia && scene.velocity_driven.drive == Drive::kLayerShear)
      scene.tangential_components = flip() ? 1 : 2;
    if (!scene.velocity_driven.taylor_quinney_factor && !(scene.interface && scene.interface->plastic_layer) &&
        !scene.junctions && !scene.layer.inertia && scene.tangential_components == 1 && flip())
      scene.layer.time_integrator = TimeIntegrator::kSdirk2;
    scene.layer.sleep = flip() && !scene.layer.inertia && scene.layer.heat == Heat::kProfile &&
                        scene.layer.time_integrator == TimeIntegrator::kBackwardEuler;
    if (!scene.velocity_driven.taylor_quinney_factor && !scene.layer.inertia && random_() % 4 == 0) {
      scene.tolerance = number(1e-6, 0.1);
      scene.layer = {.thickness_m = scene.layer.thickness_m,
                     .far_boundary = scene.layer.far_boundary,
                     .initial_temperature_k = scene.layer.initial_temperature_k};
      if (scene.hard_layer) scene.hard_layer->cells.reset(), scene.hard_layer->grading.reset();
    }
    if (flip()) scene.hydro = hydro();
    return scene;
  }

 private:
  bool flip() { return random_() % 2 == 0; }
  // Log-uniform, full mantissas; one time in four a short number as people write them.
  double number(double low, double high) {
    const double at = std::uniform_real_distribution<double>(std::log(low), std::log(high))(random_);
    const double value = std::clamp(std::exp(at), low, high);
    if (random_() % 4 != 0) return value;
    const double ten = std::pow(10.0, std::floor(std::log10(value)));
    return std::clamp(std::round(value / ten) * ten, low, high);
  }
  std::string text() {
    static constexpr std::string_view kPieces[] = {"a", "\"",   "\\",   "\n", "\t", "\xC3\xA9",        "#",
                                                   "'", "\x01", "\x7F", " ",  "]",  "\xF0\x9F\x94\xA9"};
    std::string out;
    for (std::uint64_t n = random_() % 12; n > 0; --n) out += kPieces[random_() % std::size(kPieces)];
    return out;
  }
  Body body() {
    Body body{.material = "m" + text(), .given = {}};
    if (flip()) body.given.emplace_back("density_kg_per_m3", number(1, 1e5));
    if (flip()) body.given.emplace_back("hardening_coefficient", flip() ? 0.0 : number(1e-5, 1e6));
    if (flip()) body.given.emplace_back("pressure_coefficient_per_pa", number(1e-13, 1e-6));
    if (flip()) body.flow_law = FlowLaw::kSteinbergCochranGuinan;
    return body;
  }
  Junctions junctions() {
    Junctions junctions{.contact_fraction = number(1e-3, 1), .height_m = number(1e-12, 1e-3)};
    if (flip()) junctions.yield_strength_max_pa = number(1e6, 1e12);
    if (flip()) junctions.hardening_coefficient = number(1e-3, 1e6);
    if (flip()) junctions.hardening_exponent = number(1e-3, 1);
    return junctions;
  }
  HardLayer hard_layer() {
    HardLayer layer;
    if (flip()) layer.thickness_m = number(1e-6, 1e-3);
    if (flip()) layer.cells = 1 + static_cast<std::uint32_t>(random_() % 100);
    if (flip()) layer.grading = number(1.0, 1.05);
    if (flip()) layer.far_boundary = FarBoundary::kHalfSpace;
    return layer;
  }
  std::vector<double> list(std::size_t size, double low, double high) {
    std::vector<double> values(size);
    for (double& value : values) value = number(low, high);
    return values;
  }
  Hydro hydro() {
    Hydro hydro;
    hydro.interface_law = flip() ? InterfaceLaw::kSubgrid : InterfaceLaw::kCoulombTresca;
    hydro.end_time_s = number(1e-12, 1);
    if (flip()) hydro.dt_s = number(1e-15, 1e-3);
    hydro.cfl = number(0.01, 1);
    if (flip()) {
      const std::size_t columns = 1 + random_() % 5;
      hydro.shear_column = ShearColumn{.length_m = number(1e-6, 10),
                                       .zones = 2 + static_cast<std::uint32_t>(random_() % 1000),
                                       .far_end = flip() ? FarEnd::kTransmitting : FarEnd::kFree,
                                       .velocity_jump_m_per_s = list(columns, 1e-3, 1e5),
                                       .initial_temperature_k = flip() ? std::vector<double>{} : list(1, 1, 1e4),
                                       .pressure_pa = list(columns, 1, 1e12),
                                       .pressure_time_s = {}};
    }
    hydro.coulomb_tresca.friction_coefficient_at_rest = number(0.01, 10);
    return hydro;
  }

  std::mt19937_64 random_;
};

TEST(SceneFile, WrittenAndReadBackIsTheSameToTheBit) {
  RandomScene random(20240);
  for (int i = 0; i < 2000; ++i) {
    const Scene scene = random.draw();
    ASSERT_TRUE(check_scene(scene).ok()) << check_scene(scene).text;
    const std::string toml = scene_to_toml(scene);
    const Scene again = parse_scene(toml, "again.toml").scene;
    ASSERT_EQ(again.name, scene.name);
    ASSERT_EQ(again.source, scene.source);
    ASSERT_EQ(again.soft.given, scene.soft.given);  // == of doubles: no NaN, and -0 does not occur
    ASSERT_EQ(again.soft.melting_curve, scene.soft.melting_curve);
    ASSERT_EQ(again.soft.pressure_term, scene.soft.pressure_term);
    ASSERT_EQ(again.layer.thickness_m, scene.layer.thickness_m);
    ASSERT_EQ(again.layer.grading, scene.layer.grading);
    ASSERT_EQ(again.layer.inertia, scene.layer.inertia);
    ASSERT_EQ(again.layer.sleep, scene.layer.sleep);
    ASSERT_EQ(again.tolerance, scene.tolerance);
    ASSERT_EQ(again.tangential_components, scene.tangential_components);
    ASSERT_EQ(again.layer.time_integrator, scene.layer.time_integrator);
    ASSERT_EQ(again.layer.heat, scene.layer.heat);
    ASSERT_EQ(again.layer.modes.has_value(), scene.layer.modes.has_value());
    if (scene.layer.modes) {
      ASSERT_EQ(again.layer.modes->accuracy, scene.layer.modes->accuracy);
      ASSERT_EQ(again.layer.modes->shortest_step_s, scene.layer.modes->shortest_step_s);
      ASSERT_EQ(again.layer.modes->longest_time_s, scene.layer.modes->longest_time_s);
    }
    ASSERT_EQ(again.interface.has_value(), scene.interface.has_value());
    if (scene.interface) {
      ASSERT_EQ(again.interface->friction_coefficient, scene.interface->friction_coefficient);
      ASSERT_EQ(again.interface->yield_strength_pa, scene.interface->yield_strength_pa);
      ASSERT_EQ(again.interface->plastic_layer, scene.interface->plastic_layer);
    }
    ASSERT_EQ(again.junctions.has_value(), scene.junctions.has_value());
    if (scene.junctions) {
      ASSERT_EQ(again.junctions->contact_fraction, scene.junctions->contact_fraction);
      ASSERT_EQ(again.junctions->height_m, scene.junctions->height_m);
      ASSERT_EQ(again.junctions->yield_strength_max_pa, scene.junctions->yield_strength_max_pa);
      ASSERT_EQ(again.junctions->hardening_coefficient, scene.junctions->hardening_coefficient);
      ASSERT_EQ(again.junctions->hardening_exponent, scene.junctions->hardening_exponent);
    }
    ASSERT_EQ(again.hard_layer.has_value(), scene.hard_layer.has_value());
    if (scene.hard_layer) {
      ASSERT_EQ(again.hard_layer->thickness_m, scene.hard_layer->thickness_m);
      ASSERT_EQ(again.hard_layer->cells, scene.hard_layer->cells);
      ASSERT_EQ(again.hard_layer->grading, scene.hard_layer->grading);
      ASSERT_EQ(again.hard_layer->far_boundary, scene.hard_layer->far_boundary);
    }
    ASSERT_EQ(again.velocity_driven.friction_coefficient, scene.velocity_driven.friction_coefficient);
    ASSERT_EQ(again.velocity_driven.taylor_quinney_factor, scene.velocity_driven.taylor_quinney_factor);
    ASSERT_EQ(again.interface.has_value(), scene.interface.has_value());
    if (scene.interface) {
      ASSERT_EQ(again.interface->yield_strength_pa, scene.interface->yield_strength_pa);
    }
    ASSERT_EQ(again.hydro.has_value(), scene.hydro.has_value());
    if (scene.hydro && scene.hydro->shear_column) {
      ASSERT_TRUE(again.hydro->shear_column);
      ASSERT_EQ(again.hydro->shear_column->velocity_jump_m_per_s, scene.hydro->shear_column->velocity_jump_m_per_s);
      ASSERT_EQ(again.hydro->shear_column->pressure_pa, scene.hydro->shear_column->pressure_pa);
    }
    ASSERT_EQ(scene_to_toml(again), toml);  // every other field
  }
}

// ---- the same rules without a file ----

TEST(CheckScene, NamesTheFirstFieldAtFault) {
  Scene scene = samples::scene();
  EXPECT_TRUE(check_scene(scene).ok());
  scene.layer.cells = 0;
  scene.interface->yield_strength_pa = std::nan("");
  const Status status = check_scene(scene);
  EXPECT_EQ(status.code, Code::kInvalidScene);
  EXPECT_EQ(status.field, "layer.cells");
  EXPECT_THAT(status.text, HasSubstr("layer.cells = 0 is out of range, expected at least 1 and at most 1e5"));
  EXPECT_THAT(status.text, HasSubstr("interface.yield_strength_pa = nan is not a finite number"));
}

TEST(CheckScene, APlasticLayerIsAnOptionOfForceDriven) {
  Scene scene = samples::scene();
  scene.interface = Interface{.friction_coefficient = 0.3, .yield_strength_pa = 2e8, .plastic_layer = true};
  scene.strategy = Strategy::kForceDriven;
  EXPECT_TRUE(check_scene(scene).ok());
  scene.strategy = Strategy::kVelocityDriven;
  EXPECT_EQ(check_scene(scene).field, "interface.plastic_layer");
}

TEST(CheckScene, JunctionsAreOfForceDrivenAndOfALayerThatDoesNotFlow) {
  Scene scene = samples::scene();
  scene.strategy = Strategy::kForceDriven;
  scene.interface = Interface{.friction_coefficient = 0.3, .yield_strength_pa = 2e8};
  scene.junctions = Junctions{.contact_fraction = 0.3, .height_m = 1e-7};
  EXPECT_TRUE(check_scene(scene).ok());
  scene.interface->plastic_layer = true;
  EXPECT_THAT(check_scene(scene).text, HasSubstr("[junctions] and interface.plastic_layer exclude each other"));
  scene.interface->plastic_layer = false;
  scene.strategy = Strategy::kVelocityDriven;
  EXPECT_THAT(check_scene(scene).text, HasSubstr("[junctions] is an option of strategy force_driven"));
  scene.strategy = Strategy::kForceDriven;
  scene.junctions->contact_fraction = 1.5;
  EXPECT_EQ(check_scene(scene).field, "junctions.contact_fraction");
}

TEST(CheckScene, ForceDrivenNeedsAnInterface) {
  Scene scene = samples::scene();
  scene.interface.reset();
  EXPECT_EQ(check_scene(scene).field, "strategy");
  EXPECT_THAT(check_scene(scene).text, HasSubstr("needs the table [interface]"));
}

TEST(CheckScene, RefusesWhatNoMaterialHas) {
  Scene scene = samples::scene();
  scene.soft.given.emplace_back("viscosity_pa_s", 1.0);
  EXPECT_EQ(check_scene(scene).field, "soft.viscosity_pa_s");
  scene.soft.given.back() = {"yield_strength_pa", 1e8};
  EXPECT_THAT(check_scene(scene).text, HasSubstr("given twice"));
  scene.soft.given.back() = {"material", 1e8};
  EXPECT_THAT(check_scene(scene).text, HasSubstr("is not a constant of a material"));
}

TEST(CheckScene, RefusesEnumsAndTextNoFileCouldHold) {
  Scene scene = samples::scene();
  scene.layer.far_boundary = static_cast<FarBoundary>(9);
  EXPECT_THAT(check_scene(scene).text, HasSubstr("layer.far_boundary = 9 is not one of \"insulated\", \"half_space\""));
  EXPECT_THROW(scene_to_toml(scene), Error);
  scene = samples::scene();
  scene.name = "\xFF";
  EXPECT_THAT(check_scene(scene).text, HasSubstr("name is not UTF-8 text"));
  scene.name = std::string(kMaxTextBytes + 1, 'x');
  EXPECT_THAT(check_scene(scene).text, HasSubstr("name has 4097 bytes, expected at most 4096"));
}

TEST(SceneReference, TellsOfEveryTable) {
  const std::string reference = scene_reference();
  for (const char* heading : {"## [soft], [hard]:", "## [layer]:", "## [velocity_driven]:", "## [interface]:",
                              "## [hydro]:", "## [hydro.shear_column]:", "## [hydro.coulomb_tresca]:"})
    EXPECT_THAT(reference, HasSubstr(heading));
  EXPECT_THAT(reference, HasSubstr("| `thickness_m` | number | m | 2e-05 | above 0 and at most 1 m |"));
  EXPECT_THAT(reference, HasSubstr("| `end_time_s` | number | s | required |"));
}

TEST(Nearest, FindsASlipOfTheFingerOnly) {
  const std::string_view known[] = {"cells", "thickness_m", "grading"};
  EXPECT_EQ(nearest("cels", known), "cells");
  EXPECT_EQ(nearest("clels", known), "cells");
  EXPECT_EQ(nearest("thicknes_m", known), "thickness_m");
  EXPECT_EQ(nearest("grdaing", known), "grading");
  EXPECT_EQ(nearest("x", known), "");
  EXPECT_EQ(nearest("conductivity", known), "");
  EXPECT_EQ(nearest(std::string(1'000'000, 'c'), known), "");
}

}  // namespace
}  // namespace shearbus::wire
