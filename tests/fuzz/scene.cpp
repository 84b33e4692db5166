// Fuzzes the text of a scene. For each accepted scene with few cells a session is opened; if the service opens the
// session, it must be able to step the nodes. Faults have a place; a sound scene reads back to itself.
#include <google/protobuf/descriptor.h>

#include <cmath>

#include "proto/scene/scene.hpp"
#include "server/service/scene_model.hpp"
#include "tests/fuzz/mutate.hpp"
#include "tests/fuzz/target.hpp"
#include "tests/support/service_harness.hpp"

namespace shearbus::fuzz {
namespace {

// Largest number of cells of scenes that are stepped; finer grids take longer and reveal no more faults.
constexpr std::uint32_t kMostCells = 40;

bool small(const v1::Scene& scene) {
  return scene.layer().cells() <= kMostCells && scene.hard_layer().cells() <= kMostCells;
}

void run(const std::string& text, wire::Strategy strategy) {
  const auto nodes = support::node_ids(5);
  support::ServiceHarness server;
  const support::Answer opened = server.ask(support::ServiceHarness::opening(text, nodes));
  require(opened.code() != wire::Code::kInternal, "no scene is an internal error: " + opened.reply.status.text);
  if (opened.code() != wire::Code::kOk) return;
  const std::string effective = std::get<wire::SessionOpened>(opened.reply.body).effective_scene;
  require(service::scene_model(effective, "effective").effective == effective, "an effective scene is its own");
  for (int step = 0; step < 3; ++step) {
    const support::Answer answer = server.ask(support::ServiceHarness::step(
        static_cast<std::uint64_t>(step + 1), support::step_columns(strategy, nodes, step)));
    require(answer.code() == wire::Code::kOk, "a step is run: " + answer.reply.status.text);
    for (const wire::Field field : {wire::Field::kShearStress, wire::Field::kInterfaceTemperature})
      for (const double value : answer.reply.batch.f64(field))
        require(std::isfinite(value), std::string(wire::name(field)) + " is a number");
  }
}

// Returns the pieces of text that the mutator inserts: keys and values of the schema, signs of TOML, extreme numbers.
const Parts& words() {
  static const Parts all = [] {
    Parts found = {"=",        "[",     "]",          "[[",      "\"",
                   "\"\"\"",   "'",     "#",          "\n",      ".",
                   ",",        "{",     "}",          "inf",     "nan",
                   "-",        "1e308", "1e-308",     "0",       "1",
                   "true",     "0x",    "1979-05-27", "\\u00e9", "aluminium_dlp",
                   "steel_dlp"};
    const auto add_message = [&](const google::protobuf::Descriptor& type, const auto& self) -> void {
      for (int i = 0; i < type.field_count(); ++i) {
        found.push_back(type.field(i)->name());
        if (const auto* choice = type.field(i)->enum_type())
          for (int k = 1; k < choice->value_count(); ++k) {
            std::string text = choice->value(k)->name();
            for (char& c : text) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
            found.push_back(text);
          }
        if (const auto* inner = type.field(i)->message_type()) self(*inner, self);
      }
    };
    add_message(*v1::Scene::descriptor(), add_message);
    return found;
  }();
  return all;
}

}  // namespace
}  // namespace shearbus::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace shearbus;
  scene::SceneFile file;
  try {
    file = scene::parse(std::string(reinterpret_cast<const char*>(data), size), "m.toml");
  } catch (const wire::Error& fault) {
    fuzz::require(fault.status().code == wire::Code::kInvalidScene, "a fault of a scene is INVALID_SCENE");
    fuzz::require(fault.status().text.starts_with("m.toml:"), "a fault of a scene has a place: " + fault.status().text);
    return 0;
  }
  const std::string again = scene::to_toml(file.scene);
  fuzz::require(scene::to_toml(scene::parse(again, "again.toml").scene) == again,
                "a scene written out reads back to the same");
  if (fuzz::small(file.scene)) fuzz::run(file.text, support::strategy_of(file.scene));
  return 0;
}

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size,
                                               unsigned int seed) {
  using namespace shearbus::fuzz;
  Random random(seed);
  if (random.one_in(2)) return LLVMFuzzerMutate(data, size, max_size);
  std::string text(reinterpret_cast<const char*>(data), size);
  const std::string& word = words()[random.below(words().size())];
  const std::size_t at = random.below(text.size() + 1);
  if (random.one_in(2)) {
    text.insert(at, word);
  } else {  // replaces a word of the text
    const auto is_word = [&](std::size_t i) {
      return i < text.size() && (std::isalnum(static_cast<unsigned char>(text[i])) || text[i] == '_');
    };
    std::size_t end = at;
    while (is_word(end)) ++end;
    std::size_t begin = at;
    while (begin > 0 && is_word(begin - 1)) --begin;
    text.replace(begin, end - begin, word);
  }
  return give(text, data, size, max_size);
}
