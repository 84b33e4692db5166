// Scenes as TOML text: reading, checking and writing them.
#include <gmock/gmock.h>
#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <limits>
#include <random>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "hydro_stub/scene.hpp"
#include "proto/scene/rules.hpp"
#include "proto/scene/scene.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/text.hpp"
#include "server/service/scene_model.hpp"
#include "shearbus_places.hpp"
#include "tests/support/refused.hpp"
#include "tests/support/scenes.hpp"

namespace shearbus::scene {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

// The scene from which other scenes of these tests are made.
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
[interface]                             # without it the bodies are bonded
friction_coefficient = 0.3
)";

// Returns the faults that the programs report for the TOML text of a scene, "" if none. First shearbus-hydro reads the
// text with all its tables, then the server.
std::string refusal_of(const std::string& toml) {
  const wire::Status fault = support::fault_of([&] {
    const hydro::SceneFile file = hydro::parse_scene(toml, "scene.toml");
    if (file.scene.scene().has_soft()) service::scene_model(file.server_text(), "scene.toml");
  });
  EXPECT_TRUE(fault.ok() || fault.code == wire::Code::kInvalidScene);
  return fault.text;
}

std::string load_refusal(const std::filesystem::path& path) {
  return support::fault_of([&] { load(path); }).text;
}

TEST(SceneText, AbsentKeysTakeTheirDefaults) {
  const v1::Scene scene =
      parse("name='x'\nstrategy='velocity_driven'\nsoft.material='a'\nhard.material='b'\n", "s").scene;
  EXPECT_EQ(scene.layer().thickness_m(), 20e-6);
  EXPECT_EQ(scene.layer().cells(), 500U);
  EXPECT_EQ(scene.layer().grading(), 1.0);
  EXPECT_EQ(scene.layer().far_boundary(), v1::FAR_BOUNDARY_INSULATED);
  EXPECT_EQ(scene.layer().initial_temperature_k(), 300.0);
  EXPECT_EQ(scene.layer().time_integrator(), v1::TIME_INTEGRATOR_BACKWARD_EULER);
  EXPECT_EQ(scene.layer().heat(), v1::HEAT_PROFILE);
  EXPECT_FALSE(scene.layer().has_modes());
  EXPECT_FALSE(scene.layer().inertia());
  EXPECT_EQ(scene.velocity_driven().drive(), v1::DRIVE_LAYER_SHEAR);
  EXPECT_FALSE(scene.velocity_driven().has_friction_coefficient());
  EXPECT_EQ(scene.tangential_components(), 1U);
  EXPECT_FALSE(scene.has_interface());
  EXPECT_FALSE(scene.has_hard_layer());
}

TEST(SceneText, DefaultsFollowTheChoicesThatTheyDependOn) {
  const std::string bodies =
      "soft.material='a'\nhard.material='b'\n[interface]\nfriction_coefficient=0.3\nyield_strength_pa=2e8\n";
  const v1::Scene modes = parse("name='x'\nstrategy='force_driven'\nlayer.heat='modes'\n" + bodies, "s").scene;
  EXPECT_EQ(modes.layer().modes().accuracy(), 1e-6);
  EXPECT_EQ(modes.layer().modes().shortest_step_s(), 1e-10);
  EXPECT_EQ(modes.layer().modes().longest_time_s(), 1e-4);
  const v1::Scene tolerant = parse("name='x'\nstrategy='force_driven'\ntolerance=1e-3\n" + bodies, "s").scene;
  EXPECT_FALSE(tolerant.layer().has_cells());
  EXPECT_FALSE(tolerant.layer().has_grading());
  EXPECT_EQ(tolerant.layer().heat(), v1::HEAT_UNSPECIFIED);
  EXPECT_FALSE(tolerant.layer().has_modes());
  EXPECT_EQ(tolerant.layer().thickness_m(), 20e-6);
}

TEST(SceneText, TheGuestsDefaultsAreThoseOfItsSchema) {
  const guest::Hydro hydro =
      hydro::parse_scene(std::string(kPaper) + "[hydro]\nend_time_s = 1e-6\n", "s").scene.hydro();
  EXPECT_EQ(hydro.interface_law(), guest::INTERFACE_LAW_SUBGRID);
  EXPECT_EQ(hydro.cfl(), 1.0);
  EXPECT_FALSE(hydro.has_dt_s());
  EXPECT_FALSE(hydro.has_shear_column());
  EXPECT_EQ(hydro.coulomb_tresca().friction_coefficient_at_rest(), 0.3);
  EXPECT_EQ(hydro.coulomb_tresca().friction_coefficient_fast(), 0.02);
  EXPECT_EQ(hydro.coulomb_tresca().velocity_decay_s_per_m(), 0.01);
  EXPECT_EQ(hydro.coulomb_tresca().yield_fraction(), 1.0);
}

TEST(SceneText, ConstantsGivenOverrideByName) {
  const v1::Scene scene = parse(
                              "name='x'\nstrategy='velocity_driven'\nhard.material='b'\n[soft]\nmaterial='a'\n"
                              "melting_temperature_k = 1743\nyield_strength_pa = 2.1e8\n",
                              "s")
                              .scene;
  EXPECT_THAT(numbers_of(scene.soft()), ElementsAre(std::pair<std::string, double>("yield_strength_pa", 2.1e8),
                                                    std::pair<std::string, double>("melting_temperature_k", 1743.0)));
}

TEST(SceneText, AScalarStandsForAListOfOne) {
  const guest::ShearColumn column =
      hydro::parse_scene(std::string(kPaper) +
                             "[hydro]\nend_time_s=1e-6\n[hydro.shear_column]\nlength_m=1e-3\nzones=100\n"
                             "velocity_jump_m_per_s=100\npressure_pa=[1e9, 2_000_000_000]\n",
                         "s")
          .scene.hydro()
          .shear_column();
  EXPECT_THAT(column.velocity_jump_m_per_s(), ElementsAre(100.0));
  EXPECT_THAT(column.pressure_pa(), ElementsAre(1e9, 2e9));
}

TEST(SceneText, ABooleanIsTrueOrFalse) {
  const std::string toml =
      "name='x'\nstrategy='force_driven'\nsoft.material='a'\nhard.material='b'\n"
      "[interface]\nfriction_coefficient = 0.3\nyield_strength_pa = 2e8\n";
  EXPECT_FALSE(parse(toml, "s").scene.interface().plastic_layer());
  const v1::Scene scene = parse(toml + "plastic_layer = true\n", "s").scene;
  EXPECT_TRUE(scene.interface().plastic_layer());
  EXPECT_TRUE(parse(to_toml(scene), "again").scene.interface().plastic_layer());
  EXPECT_THROW(parse(toml + "plastic_layer = 1\n", "s"), wire::Error);
}

TEST(SceneText, PlacesPointIntoTheFile) {
  const Document document = parse(kPaper, "paper.toml").document;
  EXPECT_EQ(document.where("layer.cells"), "paper.toml:9:1");
  // an absent key is reported at the line of its table
  EXPECT_EQ(document.where("soft.yield_strength_pa"), "paper.toml:3:1");
  EXPECT_EQ(document.where("strategy"), "paper.toml:2:1");
  EXPECT_EQ(document.where("layer.cells[3]"), "paper.toml:9:1");
  EXPECT_EQ(document.where("nowhere"), "paper.toml");
  EXPECT_EQ(document.where(""), "paper.toml");
}

// The server does not receive the tables of the hydrocode. The faults that it reports must nevertheless point to the
// lines of the user's file.
TEST(SceneText, TheServersTextKeepsTheLinesOfTheFile) {
  const std::string text =
      "name = 'x'\nstrategy = 'velocity_driven'\n[hydro]  # the problem\nend_time_s = 1e-6\n[hydro.shear_column]\n"
      "length_m = 1e-3\nzones = 100\nvelocity_jump_m_per_s = [1,\n  2]\npressure_pa = 1e9\n[soft]\nmaterial = "
      "'unobtainium'\n"
      "[hard]\nmaterial = 'steel_dlp'\n";
  const hydro::SceneFile file = hydro::parse_scene(text, "mine.toml");
  EXPECT_EQ(file.server_text(),
            "name = 'x'\nstrategy = 'velocity_driven'\n\n\n\n\n\n\n\n\n[soft]\nmaterial = 'unobtainium'\n"
            "[hard]\nmaterial = 'steel_dlp'\n");
  EXPECT_THAT(refusal_of(text), StartsWith("scene.toml:12:1: soft.material: "));
  const std::string dotted = "hydro.end_time_s = 1e-6\nhydro.gas_flow = {test = 'noh'}\nname = 'x'\n";
  EXPECT_EQ(without_table(dotted, "m.toml", "hydro"), "\n\nname = 'x'\n");
  EXPECT_EQ(without_table("a = 1\nb = 2", "m.toml", "b"), "a = 1\n");
  EXPECT_EQ(without_table(kPaper, "m.toml", "hydro"), kPaper);
}

// tests/golden/wire/scene_faults.txt consists of blocks: "=== title", a TOML text, "---", and the lines that the reader
// must report.
TEST(SceneText, EveryFaultIsReportedWithItsPlace) {
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

TEST(SceneText, WhatIsNoSceneFileIsRefused) {
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
  EXPECT_THAT(with("rubbish.bin", rubbish), HasSubstr(": the byte 0x"));
  EXPECT_THAT(with("zeros.bin", std::string(64, '\0')), HasSubstr("zeros.bin:1:1: the byte 0x00, which no text has"));
  EXPECT_THAT(with("program.bin", "ELF\n\x02" + std::string(64, '.')),
              HasSubstr("program.bin:2:1: the byte 0x02, which"));
  EXPECT_THAT(with("large.toml", std::string(wire::kMaxSceneBytes + 1, ' ')), HasSubstr("larger than 262144 bytes"));
  EXPECT_EQ(with("good.toml", kPaper), "");
  std::filesystem::remove_all(directory);
}

TEST(SceneText, ACommonSlipIsNamed) {
  for (const auto& [line, fault] : std::initializer_list<std::pair<const char*, const char*>>{
           {"a = 20d-6", "a = 20d-6 is not TOML: the exponent of a number has an e"},
           {"a = 1,1  # mm", "a = 1,1 is not TOML: a number has a decimal point"},
           {"a = .5", "a = .5 is not TOML: a number has digits on both sides"},
           {"a = 20e-6 m", "a = 20e-6 m is not TOML: a number stands without its unit"},
           {"a = t", "a = t is not TOML: text stands in quotes"},
           {"a = steel", "a = steel is not TOML: text stands in quotes"},
           {"a = \"steel", "a = \"steel is not TOML: the closing quote is missing"},
           {"a = “steel”", "a = “steel” is not TOML: text stands in straight quotes"},
           {"b = 1\na = 1", "a is given twice, first in line 2"},
           {"[c]\n[d]\n[c]", "[c] is given twice, first in line 2"}})
    EXPECT_THAT(
        refusal_of(std::string("a0 = 0\na = 1\n").substr(0, std::string_view(line).starts_with("b = ") ? 13 : 7) +
                   line + "\n"),
        HasSubstr(fault));
  EXPECT_THAT(refusal_of("a = " + std::string(100'000, 'x') + "\n"), HasSubstr("text stands in quotes"));
}

TEST(SceneText, TomlOfAnotherKindIsOneFault) {
  const std::string refusal =
      load_refusal(std::string(SHEARBUS_SOURCE_DIR) + "/client/examples/problems/turned_line.toml");
  EXPECT_THAT(refusal, HasSubstr(":1:1: this is no scene but TOML of another kind: it has no strategy"));
  EXPECT_EQ(std::ranges::count(refusal, '\n'), 0) << refusal;
}

TEST(SceneText, TheTableOfTheHydrocodeIsNotTheServers) {
  EXPECT_THAT(support::fault_of([] { parse(std::string(kPaper) + "[hydro]\nend_time_s = 1\n", "s"); }).text,
              HasSubstr("hydro is not a key of a scene; shearbus-hydro alone reads it: remove [hydro]"));
}

TEST(SceneText, AMissingKeyIsOneFault) {
  const std::string refusal = refusal_of(
      "name='x'\nsoft.material='a'\nhard.material='b'\ninterface.friction_coefficient=0.1\n"
      "interface.yield_strength_pa=1e8\n");
  EXPECT_THAT(refusal, HasSubstr("strategy is missing"));
  EXPECT_EQ(std::ranges::count(refusal, '\n'), 0) << refusal;
}

// The parser toml++ reads nested tables recursively, so a line of many dots would overflow the stack: the depth must be
// checked first.
TEST(SceneText, DepthIsRefusedBeforeItIsBuilt) {
  std::string key = "a";
  for (int i = 0; i < 100'000; ++i) key += ".a";
  EXPECT_THAT(refusal_of(key + " = 1\n"), HasSubstr("a key of too many parts"));
  EXPECT_THAT(refusal_of("\n[" + key + "]\n"), StartsWith("scene.toml:2:"));
  EXPECT_THAT(refusal_of("x = 'a # b'\ny = {" + key + " = 1}\n"), HasSubstr("a key of too many parts"));
  EXPECT_THAT(refusal_of("x = \"\"\"\n a . b \\\"\"\" \n\"\"\"\n" + key + " = 1\n"),
              StartsWith("scene.toml:4:18: a key of"));
  EXPECT_THAT(refusal_of("y = {x = \"\"\"a\"\"\"\"\", " + key + " = 1}\n"), HasSubstr("a key of too many parts"));
  EXPECT_THAT(refusal_of("y = {x = '''a'''', " + key + " = 1}\n"), HasSubstr("a key of too many parts"));
  EXPECT_THAT(refusal_of("x = " + std::string(100'000, '[')), HasSubstr("nested"));
  std::string tables;
  for (int i = 0; i < 15'000; ++i) tables += "{a.a.a.a.a.a=";
  EXPECT_THAT(refusal_of("x = " + tables), HasSubstr("nested"));
  EXPECT_EQ(refusal_of("source = 'a.b.c.d.e.f.g.h.i.j.k.l'  # ............\n" + std::string(kPaper)), "");
}

// Time of this thread  [s].
double cpu_s() {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

// Shortest time in which a text is read, in several trials: the machine may be busy.
double time_to_read(const std::string& toml) {
  double best = std::numeric_limits<double>::infinity();
  for (int trial = 0; trial < 3; ++trial) {
    const double begun = cpu_s();
    static_cast<void>(refusal_of(toml));
    best = std::min(best, cpu_s() - begun);
  }
  return best;
}

// The work of reading is in proportion to the length, whatever the text holds: a text four times as long takes about
// four times as long, and not sixteen times.
TEST(SceneText, WorkIsInProportionToTheLength) {
  const auto repeated = [](int count, const auto& line) {
    std::string text = kPaper;
    for (int i = 0; i < count; ++i) text += line(std::to_string(i));
    return text;
  };
  using Line = std::string (*)(const std::string&);
  const std::pair<const char*, Line> kinds[] = {
      {"pairs", [](const std::string& i) { return "[pair.p" + i + ".soft]\nmaterial = \"aluminium_dlp\"\n"; }},
      {"pairs at fault", [](const std::string& i) { return "[pair.p" + i + ".soft]\ndensity_kg_per_m3 = -1\n"; }},
      {"empty pairs", [](const std::string& i) { return "[pair.p" + i + "]\n"; }},
      {"unknown keys of pairs", [](const std::string& i) { return "[pair.p" + i + ".soft]\ndensity = 1\n"; }},
  };
  for (const auto& [kind, line] : kinds)
    EXPECT_LT(time_to_read(repeated(240, line)), 8.0 * time_to_read(repeated(60, line))) << kind;
  const std::pair<const char*, Line> long_kinds[] = {
      {"unknown keys", [](const std::string& i) { return "friction_koefficient_" + i + " = 1\n"; }},
      {"unknown tables", [](const std::string& i) { return "[interfase" + i + "]\n"; }},
      {"dotted keys", [](const std::string& i) { return "a.b.c.d.e.f.g.h.i" + i + " = 1\n"; }},
  };
  for (const auto& [kind, line] : long_kinds)
    EXPECT_LT(time_to_read(repeated(4000, line)), 8.0 * time_to_read(repeated(1000, line))) << kind;
  // What no scene has is refused before it is read.
  const double of_a_scene = time_to_read(kPaper);
  const std::string pairs = repeated(5000, kinds[0].second);
  EXPECT_LT(time_to_read(pairs), 200.0 * of_a_scene);
  EXPECT_THAT(refusal_of(pairs), HasSubstr("5000 tables [pair.NAME], at most 256 are allowed"));
}

TEST(SceneText, MoreKeysThanASceneHasAreRefused) {
  std::string keys = kPaper;
  std::string list = "name = [";
  for (int i = 0; i < 20'000; ++i) {
    keys += "a" + std::to_string(i) + " = 1\n";
    list += "1,";
  }
  EXPECT_THAT(refusal_of(keys), HasSubstr("more than 16384 keys, tables and values of lists"));
  EXPECT_THAT(refusal_of(list + "1]\n"), StartsWith("scene.toml:1:"));
  EXPECT_THAT(refusal_of(list + "1]\n"), HasSubstr("more than 16384 keys, tables and values of lists"));
  EXPECT_EQ(refusal_of("source = \"" + std::string(50'000, ',') + "\"\n" + kPaper + "# " + std::string(50'000, '=')),
            "scene.toml:1:1: source has 50000 bytes, expected at most 4096");
}

// ---- scenes that are written and read back ----

// Small scenes, any keys of which are given at random, within the bounds of each. Not all of them go together.
class RandomScene {
 public:
  explicit RandomScene(std::uint64_t seed) : random_(seed) {}

  v1::Scene draw() {
    v1::Scene scene = random_() % 2 == 0 ? support::velocity_scene() : support::force_scene();
    for (std::uint64_t n = random_() % 7; n > 0; --n) change(scene);
    return scene;
  }

 private:
  using Field = google::protobuf::FieldDescriptor;

  void change(google::protobuf::Message& table) {
    const google::protobuf::Descriptor& type = *table.GetDescriptor();
    const google::protobuf::Reflection& reflection = *table.GetReflection();
    const Field& field = *type.field(static_cast<int>(random_() % static_cast<std::uint64_t>(type.field_count())));
    if (field.is_repeated()) return;
    switch (field.cpp_type()) {
      case Field::CPPTYPE_MESSAGE:
        return change(*reflection.MutableMessage(&table, &field));
      case Field::CPPTYPE_DOUBLE:
        return reflection.SetDouble(&table, &field, number(rule_of(field)));
      case Field::CPPTYPE_UINT32:
        return reflection.SetUInt32(&table, &field, 1 + static_cast<std::uint32_t>(random_() % 60));
      case Field::CPPTYPE_BOOL:
        return reflection.SetBool(&table, &field, random_() % 2 == 0);
      case Field::CPPTYPE_STRING:
        return reflection.SetString(&table, &field, "s" + text());
      case Field::CPPTYPE_ENUM:
        return reflection.SetEnumValue(
            &table, &field,
            1 + static_cast<int>(random_() % static_cast<std::uint64_t>(field.enum_type()->value_count() - 1)));
      default:
        FAIL() << field.full_name();
    }
  }
  // Log-uniform random numbers with all digits; every fourth number has one digit only, as people write them.
  double number(const v1::Rule& rule) {
    const double high = rule.has_usual_to() ? rule.usual_to() : rule.has_at_most() ? rule.at_most() : 1.0;
    const double low = std::max(rule.has_usual_from() ? rule.usual_from() : rule.at_least(), 1e-12 * high);
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

  std::mt19937_64 random_;
};

TEST(SceneText, WrittenAndReadBackIsTheSameToTheBit) {
  RandomScene random(20240);
  int sound = 0, at_fault = 0;
  for (int i = 0; i < 4000; ++i) {
    v1::Scene scene = random.draw();
    const std::string toml = to_toml(scene);
    const bool is_sound = faults_of(scene).empty();  // faults_of() also fills in the defaults
    (is_sound ? sound : at_fault) += 1;
    v1::Scene again;
    if (!is_sound) {
      EXPECT_THROW(read(toml, "again.toml", again), wire::Error) << toml;
      continue;
    }
    ASSERT_NO_THROW(read(toml, "again.toml", again)) << toml;
    ASSERT_EQ(again.SerializeAsString(), scene.SerializeAsString()) << toml;
    ASSERT_EQ(parse(to_toml(again), "filled.toml").scene.SerializeAsString(), scene.SerializeAsString());
  }
  EXPECT_GT(sound, 1500);
  EXPECT_GT(at_fault, 300);
}

// ---- the same rules for a scene message that comes from no file ----

std::vector<Fault> faults_in(v1::Scene scene) {
  return faults_of(scene);
}

TEST(SceneRules, NameTheFirstFieldAtFault) {
  v1::Scene scene = support::force_scene();
  EXPECT_TRUE(faults_in(scene).empty());
  scene.mutable_layer()->set_cells(0);
  scene.mutable_interface()->set_yield_strength_pa(std::nan(""));
  const std::vector<Fault> faults = faults_in(scene);
  ASSERT_EQ(faults.size(), 2U);
  EXPECT_EQ(faults[0].path, "layer.cells");
  EXPECT_EQ(faults[0].text, "layer.cells = 0 is out of range, expected at least 1 and at most 1e5");
  EXPECT_EQ(faults[1].text, "interface.yield_strength_pa = nan is not a finite number");
}

// What the physics excludes is reported with its place in the TOML text. The exclusions are those of
// server/physics/solver/parts.hpp.
TEST(SceneRules, WhatThePhysicsExcludesIsReportedWithItsPlace) {
  const std::string force =
      "name = 'x'\nstrategy = 'force_driven'\nsoft.material = 'aluminium_dlp'\nhard.material = 'steel_dlp'\n"
      "[interface]\nfriction_coefficient = 0.3\nyield_strength_pa = 2e8\n";
  const std::string junctions = "[junctions]\ncontact_fraction = 0.3\nheight_m = 1e-7\n";
  EXPECT_EQ(refusal_of(force + "plastic_layer = true\n"), "");
  EXPECT_EQ(refusal_of(force + junctions), "");
  EXPECT_EQ(refusal_of(force + "plastic_layer = true\n" + junctions), "");
  const std::string weakening =
      "friction_law = 'velocity_weakening'\nfriction_coefficient_fast = 0.02\nvelocity_decay_s_per_m = 0.01\n";
  EXPECT_EQ(refusal_of(force + weakening + junctions), "");
  const std::string film = "[melt_film]\nlatent_heat_j_per_kg = 4e5\nviscosity_pa_s = 1e-3\n[hard_layer]\n";
  EXPECT_THAT(refusal_of(force + junctions + film),
              StartsWith("scene.toml:11:1: [melt_film] does not go with [junctions]"));
  EXPECT_THAT(refusal_of(force + "taylor_quinney_factor = 0.9\n[hard_layer]\n"),
              StartsWith("scene.toml:8:1: interface.taylor_quinney_factor heats where the layer flows"));
  std::string velocity = force;
  velocity.replace(velocity.find("force_driven"), 12, "velocity_driven");
  EXPECT_EQ(refusal_of(velocity + junctions), "");
  EXPECT_THAT(refusal_of(velocity), StartsWith("scene.toml:7:1: interface.yield_strength_pa is for force_driven"));
  velocity.erase(velocity.find("yield_strength_pa"));
  EXPECT_EQ(refusal_of(velocity), "");
  EXPECT_THAT(refusal_of(velocity + junctions), StartsWith("scene.toml:5:1: interface.yield_strength_pa is missing"));
  EXPECT_THAT(refusal_of(velocity + "plastic_layer = true\n"), StartsWith("scene.toml:7:1: interface.plastic_layer"));
  EXPECT_THAT(
      refusal_of(force + "[layer]\ninitial_temperature_k = 1500\n"),
      StartsWith("scene.toml:9:1: layer.initial_temperature_k = 1500 K is not below soft.melting_temperature_k = "
                 "1220 K"));
  EXPECT_THAT(refusal_of(force + "[soft]\nmelting_temperature_k = 100\n").substr(0, 15), StartsWith("scene.toml:"));
  EXPECT_THAT(refusal_of(force + "[pair.a.layer]\ninitial_temperature_k = 1500\n"),
              StartsWith("scene.toml:9:1: [pair.a]: layer.initial_temperature_k = 1500 K is not below"));
  // Of two keys that contradict each other, the one that the text has is shown.
  EXPECT_THAT(
      refusal_of(force + "[layer]\nheat = 'modes'\n[layer.modes]\naccuracy = 1e-3\nshortest_step_s = 1\n"),
      StartsWith("scene.toml:12:1: layer.modes.longest_time_s = 0.0001 s is below layer.modes.shortest_step_s = 1"));
  EXPECT_THAT(refusal_of(force + "[layer]\nfar_boundary = 'insulated'\nthickness_m = 1e-8\n"),
              StartsWith("scene.toml:10:1: layer.thickness_m = 1e-08 m, layer.cells = 500 and"));
  // A scene with several faults: all are reported together, each with its line, in the order of the text.
  const std::string several =
      refusal_of(force + "plastic_layer = true\n[layer]\nsleep = true\nheat = 'modes'\ninertia = true\n");
  EXPECT_THAT(several, HasSubstr("scene.toml:10:1: layer.sleep = true does not go with layer.inertia"));
  EXPECT_THAT(several, HasSubstr(" (Leave out layer.sleep = true, or leave out layer.inertia = true.)\n"));
  EXPECT_THAT(several, HasSubstr("\nscene.toml:11:1: layer.heat = \"modes\" does not go with interface.plastic_layer"));
  EXPECT_LT(several.find(":10:1:"), several.find(":11:1:"));
}

TEST(SceneRules, AConstantThatNoMaterialHasIsRefused) {
  v1::Body body;
  EXPECT_THROW(set_numbers({{"viscosity_pa_s", 1.0}}, body), std::invalid_argument);
  EXPECT_THROW(set_numbers({{"material", 1e8}}, body), std::invalid_argument);
  set_numbers({{"yield_strength_pa", 1e8}}, body);
  EXPECT_EQ(body.yield_strength_pa(), 1e8);
}

TEST(SceneRules, RefuseEnumsAndTextNoFileCouldHold) {
  v1::Scene scene = support::force_scene();
  scene.mutable_layer()->set_far_boundary(static_cast<v1::FarBoundary>(9));
  EXPECT_THAT(faults_in(scene).front().text,
              HasSubstr("layer.far_boundary = 9 is not one of \"insulated\", \"half_space\", \"isothermal\""));
  EXPECT_THROW(to_toml(scene), wire::Error);
  scene = support::force_scene();
  scene.set_name(std::string(wire::kMaxTextBytes + 1, 'x'));
  EXPECT_THAT(faults_in(scene).front().text, HasSubstr("name has 4097 bytes, expected at most 4096"));
  EXPECT_THAT(refusal_of("name = \"\xFF\"\n"), StartsWith("scene.toml:1:"));
}

TEST(SceneReference, HasEveryTable) {
  const std::string scene = reference_of(*v1::Scene::descriptor());
  const std::string hydro = hydro::reference();
  for (const char* heading : {"## [soft], [hard]:", "## [layer]:", "## [velocity_driven]:", "## [interface]:"}) {
    EXPECT_THAT(scene, HasSubstr(heading));
    EXPECT_THAT(hydro, HasSubstr(heading));
  }
  for (const char* heading : {"## [hydro]:", "## [hydro.shear_column]:", "## [hydro.coulomb_tresca]:"}) {
    EXPECT_THAT(scene, ::testing::Not(HasSubstr(heading)));
    EXPECT_THAT(hydro, HasSubstr(heading));
  }
  EXPECT_THAT(
      scene,
      HasSubstr("| `thickness_m` | number | m | 2e-05 | above 0 and at most 1 m; usually from 1e-08 to 0.01 m |"));
  EXPECT_THAT(hydro, HasSubstr("| `end_time_s` | number | s | required |"));
}

TEST(Nearest, FindsASlipOfTheFingerOnly) {
  const std::string_view known[] = {"cells", "thickness_m", "grading"};
  EXPECT_EQ(wire::nearest("cels", known), "cells");
  EXPECT_EQ(wire::nearest("clels", known), "cells");
  EXPECT_EQ(wire::nearest("thicknes_m", known), "thickness_m");
  EXPECT_EQ(wire::nearest("grdaing", known), "grading");
  EXPECT_EQ(wire::nearest("grad", known), "grading");
  EXPECT_EQ(wire::nearest("thickness", known), "thickness_m");
  EXPECT_EQ(wire::nearest("gra", known), "");
  EXPECT_EQ(wire::nearest("x", known), "");
  EXPECT_EQ(wire::nearest("conductivity", known), "");
  EXPECT_EQ(wire::nearest(std::string(1'000'000, 'c'), known), "");
}

}  // namespace
}  // namespace shearbus::scene
