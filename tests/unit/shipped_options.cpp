// Every option of the table of parts, and every law, occurs in a scene that we ship.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>
#include <string>
#include <string_view>

#include "server/physics/interface/friction_laws.hpp"
#include "server/physics/material/flow_laws.hpp"
#include "server/physics/solver/parts.hpp"
#include "server/service/scene_model.hpp"
#include "shearbus_places.hpp"

namespace shearbus {
namespace {

// Returns a scene's text without the table [hydro] of shearbus-hydro, which the service does not know.
std::string scene_text(const std::filesystem::path& path) {
  std::ifstream file(path);
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  const std::size_t host = text.find("\n[hydro");
  return host == std::string::npos ? text : text.substr(0, host + 1);
}

// Expects each law of a list among those that scenes have.
template <class Laws>
void expect_all(const char* key, const std::set<std::string_view>& found) {
  for (int number = 1; Laws::numbered(number); ++number) {
    const std::string_view law = Laws::name_of(*Laws::numbered(number));
    if (law == physics::Own::kName) continue;  // client/examples/friction_law.c: a server must have loaded it
    EXPECT_TRUE(found.contains(law)) << "no shipped scene has " << key << " = \"" << law << "\"";
  }
}

TEST(ShippedScenes, ShowEveryOptionAndEveryLaw) {
  std::set<std::string_view> laws;
  std::set<physics::Property> options;
  // The files of client/examples/problems state problems for hosts of any kind, and those of verification have no layer.
  for (const char* room : {"client/examples", "hydro_stub/problems"}) {
    for (const auto& file : std::filesystem::directory_iterator(std::filesystem::path(SHEARBUS_SOURCE_DIR) / room)) {
      if (file.path().extension() != ".toml") continue;
      const std::string text = scene_text(file.path());
      const physics::ModelOptions model = service::scene_model(text, file.path().string()).options;
      for (const physics::Part& part : physics::parts())
        if (part.is_on(model)) options.insert(part.property);
      laws.insert(physics::FrictionLaws::name_of(model.interface.friction_law));
      laws.insert(physics::FlowLaws::name_of(model.soft.flow_law));
    }
  }
  for (const physics::Part& part : physics::parts()) {
    if (part.adds.empty()) continue;  // no row on the page of the options
    EXPECT_TRUE(options.contains(part.property))
        << "no shipped scene has " << physics::unique_key(part) << ": write one that shows what it does";
  }
  expect_all<physics::FrictionLaws>("interface.friction_law", laws);
  expect_all<physics::FlowLaws>("soft.flow_law", laws);
}

}  // namespace
}  // namespace shearbus
