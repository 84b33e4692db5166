// The C++ interface against a live server: cxx_library SCENE.toml ENDPOINT. Compiled as C++17 with the headers for hosts
// alone. Every fault is printed, and the exit code is 1 if there is one.
#include <array>
#include <cmath>
#include <shearbus/client.hpp>
#include <string>
#include <vector>

#include "host_checks.hpp"

namespace {

constexpr std::size_t kNodes = 6;
constexpr double kDt = 1e-9;
std::string scene, endpoint;

using Column = std::vector<double>;

// The columns of a step in far-field form. The steps of this program apply no answer.
struct Host {
  shearbus::Ids ids;
  Column jump, pressure, stress_soft, stress_hard, mass_soft, mass_hard, stress, temperature;
  std::vector<std::uint8_t> regime;

  explicit Host(std::uint64_t first = 1000)
      : mass_soft(kNodes, 4e-3), mass_hard(kNodes, 12e-3), stress(kNodes, -1), temperature(kNodes, -1), regime(kNodes) {
    for (std::size_t i = 0; i < kNodes; ++i) {
      const auto x = static_cast<double>(i);
      ids.push_back(first + 7 * i);
      jump.push_back(90 + x);
      pressure.push_back(2e8 * static_cast<double>(1 + i % 3));
      stress_soft.push_back(1e6 * x);
      stress_hard.push_back(-1e6 * x);
    }
  }
  shearbus::Step step(double dt = kDt) {
    shearbus::Step made(kNodes);
    made.in(SHEARBUS_VELOCITY_JUMP, jump)
        .in(SHEARBUS_PRESSURE, pressure)
        .in(SHEARBUS_STRESS_SOFT, stress_soft)
        .in(SHEARBUS_STRESS_HARD, stress_hard)
        .in(SHEARBUS_MASS_SOFT, mass_soft)
        .in(SHEARBUS_MASS_HARD, mass_hard)
        .out(SHEARBUS_SHEAR_STRESS, stress)
        .out(SHEARBUS_INTERFACE_TEMPERATURE, temperature)
        .out(SHEARBUS_REGIME, regime)
        .dt(dt);
    return made;
  }
};

shearbus::Options options_of() {
  shearbus::Options options;
  options.endpoint = endpoint;
  options.scene_file = scene;
  options.check_closure = SHEARBUS_CHECK_OFF;
  options.idle_limit_s = 3600;
  options.connect_deadline_s = 20;
  return options;
}

void errors() {
  Host host;
  shearbus::Options options = options_of();
  options.scene_file = "/nowhere.toml";
  REFUSED(shearbus::Session(options, host.ids), SHEARBUS_INVALID_SCENE, "/nowhere.toml: cannot be opened");
  options = options_of();
  options.endpoint = "ipc:///tmp/shearbus-nobody-listens";
  options.connect_deadline_s = 0.2;
  REFUSED(shearbus::Session(options, host.ids), SHEARBUS_UNREACHABLE, "no server answered");
  const auto twice = REFUSED(shearbus::Session(options_of(), {7, 8, 7}), SHEARBUS_DUPLICATE_NODE, "");
  CHECK(twice && twice->nodes() == std::vector<std::uint64_t>{7} && !twice->remedy().empty());
  options = options_of();
  options.endpoint = "embedded";
  options.domain = "d";
  REFUSED(shearbus::Session(options, host.ids), SHEARBUS_UNSUPPORTED, "nodes cannot move");
  bool thrown = false;
  try {
    shearbus::Session(options_of(), host.ids, {300.0});
  } catch (const std::invalid_argument&) {
    thrown = true;
  }
  CHECK(thrown);

  shearbus::Session bus(options_of(), host.ids);
  const std::uint64_t before = bus.info().last_sequence;
  Column shorter(kNodes - 1);
  const auto shape = REFUSED(host.step().in(SHEARBUS_PRESSURE, shorter), SHEARBUS_SHAPE, "5 values, expected 6");
  CHECK(shape && shape->field() == "pressure_pa");
  REFUSED(host.step().out(SHEARBUS_OUTCOME, host.stress), SHEARBUS_SHAPE, "uint8_t");
  REFUSED(host.step().out(SHEARBUS_SHEAR_STRESS, host.regime), SHEARBUS_SHAPE, "double");
  REFUSED(bus.step(host.step(0.0)), SHEARBUS_INVALID_VALUE, "dt");
  host.pressure[4] = NAN;
  const auto value = REFUSED(bus.step(host.step()), SHEARBUS_INVALID_VALUE, "pressure_pa");
  CHECK(value && value->field() == "pressure_pa" && value->nodes() == std::vector<std::uint64_t>{host.ids[4]});
  REFUSED(bus.commit(), SHEARBUS_NOTHING_TO_COMMIT, "");
  REFUSED(bus.rollback_to("never"), SHEARBUS_UNKNOWN_MARK, "never");
  REFUSED(shearbus::Session::resume(options_of(), "abc"), SHEARBUS_INVALID_VALUE, "ticket");
  CHECK(bus.info().last_sequence == before && host.stress == Column(kNodes, -1));  // nothing of it counted
  bus.close();
  REFUSED(bus.commit(), SHEARBUS_INVALID_VALUE, "no session");
}

void steps() {
  Host host;
  shearbus::Session bus(options_of(), host.ids);
  CHECK(bus.node_ids() == host.ids && bus.effective_scene().find("thickness_m") != std::string::npos);
  CHECK(bus.columns(SHEARBUS_REQUIRED_INPUT).size() == 6 && bus.info().strategy == 2);
  bus.mark("start");
  const shearbus_result result = bus.step(host.step());
  const Column first = host.temperature, first_stress = host.stress;
  const shearbus::Profiles profiles = bus.profiles({host.ids[3], host.ids[0]}, {1e9, 2e9});
  CHECK(profiles.nodes == 2 && profiles.vertices > 10 && profiles(SHEARBUS_POSITION)[0] == 0.0);
  CHECK(profiles(SHEARBUS_LAYER_TEMPERATURE)[0] == first[3]);
  CHECK(profiles(SHEARBUS_LAYER_TEMPERATURE)[profiles.vertices] == first[0]);
  CHECK(profiles(SHEARBUS_LAYER_SHEAR_STRESS)[profiles.vertices] == first_stress[0]);
  REFUSED(bus.profiles({424242}), SHEARBUS_UNKNOWN_NODE, "424242");
  CHECK(result.nodes == kNodes && first[0] > 300 && host.stress[0] > 0 && host.regime[0] != 0);
  bus.step(host.step());
  const Column second = host.temperature;
  CHECK(second[0] > first[0]);

  bus.rollback_to("start");
  const Host fresh;
  host = fresh;
  bus.start(host.step());  // in two halves
  host.jump.assign(kNodes, 0.0);
  bus.finish();
  CHECK(host.temperature == first);
  bus.trial(host.step());  // with another jump; it leaves no trace
  bus.rollback();
  host.jump = fresh.jump;
  bus.trial(host.step());
  bus.commit();
  CHECK(host.temperature == second);

  // Some nodes, in another order; the others keep their states, or cool.
  bus.rollback_to("start");
  const shearbus::Ids some = {host.ids[4], host.ids[0]};
  struct Row {
    double jump, pressure, soft, hard, mass_soft, mass_hard, temperature;
  };
  std::vector<Row> rows;
  for (const std::size_t i : {4, 0})
    rows.push_back({host.jump[i], host.pressure[i], host.stress_soft[i], host.stress_hard[i], 4e-3, 12e-3, 0.0});
  constexpr auto kStride = static_cast<std::ptrdiff_t>(sizeof(Row));
  const auto subset = [&](bool open_absent) {
    shearbus::Step step(some);
    step.in_strided(SHEARBUS_VELOCITY_JUMP, &rows[0].jump, kStride)
        .in_strided(SHEARBUS_PRESSURE, &rows[0].pressure, kStride)
        .in_strided(SHEARBUS_STRESS_SOFT, &rows[0].soft, kStride)
        .in_strided(SHEARBUS_STRESS_HARD, &rows[0].hard, kStride)
        .in_strided(SHEARBUS_MASS_SOFT, &rows[0].mass_soft, kStride)
        .in_strided(SHEARBUS_MASS_HARD, &rows[0].mass_hard, kStride)
        .out_strided(SHEARBUS_INTERFACE_TEMPERATURE, &rows[0].temperature, kStride);
    bus.step(step.dt(kDt).open_absent(open_absent));
  };
  subset(false);
  CHECK(rows[0].temperature == first[4] && rows[1].temperature == first[0]);
  bus.rollback_to("start");
  double kept = 0.0;
  for (const bool open_absent : {false, true}) {
    bus.rollback_to("start");
    bus.step(host.step());
    subset(open_absent);
    bus.step(host.step());
    if (!open_absent) kept = host.temperature[2];
  }
  CHECK(kept == second[2] && host.temperature[2] < kept && host.temperature[2] > 300);
  bus.close();
}

void moves() {
  Host host(100);
  shearbus::Session alone(options_of(), host.ids);
  alone.step(host.step());
  alone.step(host.step());
  const Column stayed = host.temperature;
  alone.close();

  shearbus::Options options = options_of();
  options.domain = "cxx_library";
  shearbus::Session giver(options, host.ids), taker(options, {});
  REFUSED(taker.register_nodes({host.ids[0]}), SHEARBUS_NODE_OWNED, "");
  giver.step(host.step());
  const shearbus::TransferId transfer = giver.offer_nodes(host.ids);
  const std::string ticket = giver.ticket();
  { const shearbus::Session left = std::move(giver); }  // its end leaves the session on the server
  shearbus::Session again = shearbus::Session::resume(options, ticket);
  CHECK(again.node_ids().empty() && again.offers().size() == 1 && again.offers()[0] == transfer);
  taker.accept_nodes(transfer);
  CHECK(taker.node_ids() == host.ids);
  taker.step(host.step());
  CHECK(host.temperature == stayed);
  REFUSED(taker.accept_nodes(transfer), SHEARBUS_UNKNOWN_TRANSFER, "");
  again.register_nodes({5, 6}, {310.0, 320.0});
  again.retire_nodes({5});
  CHECK(again.node_ids() == shearbus::Ids{6});
  again.close();
  taker.close();
}

// Nodes with parameters of their own have the bits of sessions whose scene has these values.
void parameters() {
  const std::string key = "interface.friction_coefficient";
  Host host;
  shearbus::Nodes nodes;
  nodes.ids = host.ids;
  nodes.parameters = {{key, {}}};
  for (std::size_t i = 0; i < kNodes; ++i) nodes.parameters[0].second.push_back(i % 2 == 0 ? 0.1 : 0.2);
  shearbus::Session both = shearbus::Session::open_nodes(options_of(), nodes);
  both.step(host.step());
  const Column together = host.stress;
  nodes.parameters[0].second.assign(kNodes, 0.2);
  shearbus::Session one = shearbus::Session::open_nodes(options_of(), nodes);
  one.step(host.step());
  bool differ = false;
  for (std::size_t i = 0; i < kNodes; ++i) {
    CHECK(i % 2 == 0 || host.stress[i] == together[i]);
    differ = differ || host.stress[i] != together[i];
  }
  CHECK(differ);
  nodes.ids = {1};
  nodes.parameters[0].second = {11.0};
  REFUSED(one.add_nodes(nodes), SHEARBUS_INVALID_VALUE, "parameters of node 1: interface.friction_coefficient = 11");
  nodes.parameters[0].second = {0.2};
  nodes.pair = {""};
  one.add_nodes(nodes);
  CHECK(one.node_ids().back() == 1);
  // A host that resumes with other parameters is refused, and the session stays as it is.
  const std::string ticket = one.ticket();
  { const shearbus::Session left = std::move(one); }
  nodes.parameters[0].second = {0.3};
  REFUSED(shearbus::Session::resume(options_of(), ticket, nodes), SHEARBUS_RESUME_REFUSED,
          "interface.friction_coefficient of node 1 is 0.2 in the session, 0.3 of the host");
  nodes.parameters[0].second = {0.2};
  one = shearbus::Session::resume(options_of(), ticket, nodes);
  CHECK(one.node_ids().size() == kNodes + 1);
  nodes.parameters[0].first = "soft.density_kg_per_m3";
  REFUSED(one.add_nodes(nodes), SHEARBUS_SHAPE, "whose parameters are: interface.friction_coefficient");
  one.close();
  both.close();
}

void operators() {
  Host host;
  shearbus::Session bus(options_of(), host.ids);
  bus.step(host.step());
  shearbus::Operator server(options_of());
  shearbus::Operator moved = std::move(server);
  CHECK(moved.ask(SHEARBUS_ASK_STATUS).find("\"sessions\": 1,") != std::string::npos);
  CHECK(moved.ask(SHEARBUS_ASK_SESSIONS).find(bus.ticket().substr(0, 32)) != std::string::npos);
  bus.set_reply_deadline(5.0);
  CHECK(bus.end().node_steps == kNodes && bus.text(SHEARBUS_DURABILITY) == "none");
  shearbus::Options options = options_of();
  options.scene_file.clear();
  options.scene_name = "keys.toml";
  for (int i = 0; i < 60; ++i) options.scene_text += "unknown_key_" + std::to_string(i) + " = 1\n";
  const auto long_list = REFUSED(shearbus::Session(options, host.ids), SHEARBUS_INVALID_SCENE, "keys.toml:1:1: ");
  CHECK(long_list && long_list->text().find("unknown_key_30") != std::string::npos);
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 3) return 2;
  scene = argv[1];
  endpoint = argv[2];
  errors();
  steps();
  moves();
  parameters();
  operators();
  if (faults == 0) std::printf("the C++ interface keeps its contract\n");
  return faults == 0 ? 0 : 1;
} catch (const std::exception& fault) {
  std::fprintf(stderr, "%s\n", fault.what());
  return 1;
}
