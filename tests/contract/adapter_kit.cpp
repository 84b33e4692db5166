// What helps the author of a host, against a live server: the law for contact codes (contact_law.hpp), in two and three
// dimensions, and the host's own law while the server is gone. Compiled as C++17 with the headers for hosts alone:
//   adapter_kit SCENE.toml ENDPOINT PID_FILE      a durable server, which is started again when it was killed
// Every fault is printed, and the exit code is 1 if there is one.
#include <signal.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <shearbus/contact_law.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "host_checks.hpp"

namespace {

using shearbus::Vector;

constexpr double kDt = 1e-9, kJump = 100.0, kArea = 2.5e-7;
constexpr double kMassSoft = 4.32e-3, kMassHard = 12.3e-3;  // per area [kg/m2]
std::string scene_text, endpoint, pid_file;

std::string with_components(int components) {
  const std::string key = "strategy = ";
  std::string text = scene_text;
  return text.insert(text.find(key), "tangential_components = " + std::to_string(components) + "\n");
}

shearbus::Options options(int components, std::string* told = nullptr) {
  shearbus::Options options;
  options.scene_text = with_components(components);
  options.endpoint = endpoint;
  options.retry_after_s = 0.2;
  options.log = [told](const std::string& line) {
    if (told != nullptr) *told += line + "\n";
  };
  return options;
}

double dot(const Vector& a, const Vector& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
Vector scaled(double factor, const Vector& v) {
  return {factor * v[0], factor * v[1], factor * v[2]};
}
Vector sum(const Vector& a, const Vector& b) {
  return {a[0] + b[0], a[1] + b[1], a[2] + b[2]};
}

// Two lumps that slide on each other on a plane of this normal along `direction`, pressed by forces of their own: the
// law's friction is mu P until they stick, whatever the frame is, in both forms.
void lumps(int dimensions, const Vector& normal, const Vector& direction, bool stick) {
  constexpr double kFriction = 0.1, kPressure = 5e8;
  shearbus::ContactLaw law(options(dimensions - 1), {7}, dimensions);
  Vector v_soft = scaled(kJump, direction), v_hard{}, force = scaled(-3.0, direction);
  law.want(SHEARBUS_HEAT_TO_SOFT);
  law.want(SHEARBUS_HEAT_TO_HARD);
  double time = 0.0;
  for (int step = 1; step <= 40; ++step) {
    time += kDt;
    const Vector jump = sum(v_soft, scaled(-1.0, v_hard));
    const double impedance = 1.0 / (kDt * (1.0 / kMassSoft + 1.0 / kMassHard));
    const Vector free = sum(jump, scaled(kDt / (kMassSoft * kArea), force));
    if (stick)
      law.touch(7, shearbus::StickContact{normal, jump, kPressure, scaled(impedance, free), impedance});
    else
      law.touch(7, shearbus::Contact{normal, jump, kPressure, kArea, force, {}, kMassSoft * kArea, kMassHard * kArea});
    law.solve(kDt, time, static_cast<std::uint64_t>(step));
    const Vector traction = law.traction(7);
    CHECK(std::fabs(dot(traction, normal)) < 1e-3);
    if (step == 1) CHECK(std::fabs(dot(traction, direction) / (-kFriction * kPressure) - 1.0) < 1e-9);
    v_soft = sum(v_soft, scaled(kDt / kMassSoft, sum(traction, scaled(1.0 / kArea, force))));
    v_hard = sum(v_hard, scaled(-kDt / kMassHard, traction));
    if (step > 1) continue;
    const Vector mean = scaled(0.5, sum(jump, sum(v_soft, scaled(-1.0, v_hard))));
    const double heat = law.value(SHEARBUS_HEAT_TO_SOFT, 7) + law.value(SHEARBUS_HEAT_TO_HARD, 7);
    CHECK(std::fabs(heat / (-kDt * dot(traction, mean)) - 1.0) < 1e-9);
    CHECK(law.regime(7) == SHEARBUS_REGIME_COULOMB);
  }
  const double exact =
      kJump - 40 * kDt * (kFriction * kPressure * (1.0 / kMassSoft + 1.0 / kMassHard) + 3.0 / (kArea * kMassSoft));
  const double found = dot(sum(v_soft, scaled(-1.0, v_hard)), direction);
  if (std::fabs(found - std::fmax(exact, 0.0)) > 1e-6) {
    std::fprintf(stderr, "%d dimensions%s: the jump is %.9f, expected %.9f\n", dimensions, stick ? ", stick form" : "",
                 found, exact);
    ++faults;
  }
  CHECK(law.temperature(7) > 300.0);
  law.session().close();
}

// A plane that turns by half a circle: the traction stays against the slip, and its size mu P.
void turning_plane() {
  shearbus::Options given = options(2);
  given.check_closure = SHEARBUS_CHECK_OFF;
  shearbus::ContactLaw law(given, {3}, 3);
  for (int step = 0; step <= 50; ++step) {
    const double angle = 3.14159265358979 * step / 50;
    const Vector normal = {std::sin(angle), 0.0, std::cos(angle)},
                 along = {std::cos(angle) * 0.6, 0.8, -std::sin(angle) * 0.6};
    law.touch(
        3, shearbus::Contact{normal, scaled(kJump, along), 5e8, kArea, {}, {}, kMassSoft * kArea, kMassHard * kArea});
    law.solve(kDt);
    const Vector traction = law.traction(3);
    CHECK(std::fabs(dot(traction, along) / -5e7 - 1.0) < 1e-9 && std::fabs(dot(traction, normal)) < 1.0);
  }
  law.session().close();
}

shearbus::Contact plain() {
  return {{0, 1, 0}, {kJump, 0, 0}, 5e8, kArea, {}, {}, kMassSoft * kArea, kMassHard * kArea};
}

// Nodes that come, go and return; what a code does wrong is told, with the node, and changes nothing.
void nodes_and_refusals() {
  shearbus::Options given = options(1);
  given.check_closure = SHEARBUS_CHECK_OFF;
  given.domain = "kit";
  shearbus::ContactLaw law(given, {1}, 2);
  law.touch(1, plain());
  REFUSED(law.touch(1, plain()), SHEARBUS_DUPLICATE_NODE, "node 1 is touched twice");
  REFUSED(law.traction(1), SHEARBUS_INVALID_VALUE, "solve() first");
  law.touch(2, plain());  // new: registered by solve()
  REFUSED(law.touch(4, shearbus::StickContact{{0, 1, 0}, {}, 0, {}, 1}), SHEARBUS_SHAPE, "node 4");
  shearbus::Contact wrong = plain();
  wrong.normal = {0, 2, 0};
  REFUSED(law.touch(5, wrong), SHEARBUS_INVALID_VALUE, "node 5: the normal has the length 2");
  wrong = plain();
  wrong.area = 0;
  REFUSED(law.touch(6, wrong), SHEARBUS_INVALID_VALUE, "node 6: area and masses");
  law.solve(kDt, kDt, 1);
  CHECK(law.session().node_ids() == (shearbus::Ids{1, 2}));
  CHECK(std::fabs(law.traction(1)[0] + 5e7) < 1e-2 && law.traction(2) == law.traction(1));
  CHECK(law.traction(9) == Vector{} && !law.touches(9));
  REFUSED(law.temperature(9), SHEARBUS_UNKNOWN_NODE, "node 9");
  REFUSED(law.value(SHEARBUS_HEAT_TO_SOFT, 1), SHEARBUS_UNSUPPORTED, "want()");
  const double hot = law.temperature(1);
  for (int step = 0; step < 20; ++step) law.solve(kDt);  // nothing touches: both cool
  law.touch(1, plain());
  law.solve(1e-15);
  CHECK(law.temperature(1) < hot && law.temperature(1) > 300.0);
  CHECK(law.touches(1) && !law.touches(2));
  // After a refused solve() the same one is refused again, and touch() begins another step.
  wrong = plain();
  wrong.pressure = std::nan("");
  law.touch(1, wrong);
  REFUSED(law.solve(kDt), SHEARBUS_INVALID_VALUE, "pressure_pa of node 1");
  REFUSED(law.solve(kDt), SHEARBUS_INVALID_VALUE, "pressure_pa of node 1");
  law.touch(1, plain());
  law.solve(kDt);
  CHECK(law.touches(1));
  // Nor does a node stay in the way that another session of the domain has.
  shearbus::ContactLaw neighbour(given, {50}, 2);
  law.touch(50, plain());
  REFUSED(law.solve(kDt), SHEARBUS_NODE_OWNED, "node 50");
  law.touch(2, plain());
  law.solve(kDt);
  CHECK(law.touches(2) && !law.touches(50) && law.session().node_ids() == (shearbus::Ids{1, 2}));
  neighbour.session().close();
  REFUSED(shearbus::ContactLaw other(options(1), {1}, 3), SHEARBUS_SHAPE, "tangential_components = 1");
  law.session().close();
}

// Each of many nodes, whose ids share their low bits or their high ones and come in changing order, gets its own answer.
void many_nodes() {
  constexpr std::uint64_t kNodes = 200;
  shearbus::Options given = options(1);
  given.check_closure = SHEARBUS_CHECK_OFF;
  shearbus::ContactLaw law(given, {0}, 2);
  const auto id_of = [](std::uint64_t k) { return k % 2 == 0 ? k << 32U : ~k; };
  for (const std::uint64_t stride : {1, 37, 83}) {
    for (std::uint64_t i = 0; i < kNodes; ++i) {
      const std::uint64_t k = i * stride % kNodes;
      shearbus::Contact at = plain();
      at.pressure = 1e6 * static_cast<double>(k + 1);
      law.touch(id_of(k), at);
    }
    law.solve(kDt);
    for (std::uint64_t k = 0; k < kNodes; ++k)
      CHECK(std::fabs(law.traction(id_of(k))[0] + 1e5 * static_cast<double>(k + 1)) < 1e-3);
  }
  CHECK(law.session().node_ids().size() == kNodes);
  law.session().close();
}

pid_t pid_of_server() {
  std::ifstream file(pid_file);
  pid_t pid = 0;
  file >> pid;
  return pid;
}

struct Sliding {  // one node of a host that keeps its jump
  std::vector<double> jump{kJump}, pressure{5e8}, stress_soft{0}, stress_hard{0}, mass_soft{kMassSoft},
      mass_hard{kMassHard}, stress{0}, temperature{0};
  std::vector<std::uint8_t> outcome{0};
  shearbus::Step step{1};
  Sliding() {
    step.in(SHEARBUS_VELOCITY_JUMP, jump).in(SHEARBUS_PRESSURE, pressure);
    step.in(SHEARBUS_STRESS_SOFT, stress_soft).in(SHEARBUS_STRESS_HARD, stress_hard);
    step.in(SHEARBUS_MASS_SOFT, mass_soft).in(SHEARBUS_MASS_HARD, mass_hard);
    step.out(SHEARBUS_SHEAR_STRESS, stress).out(SHEARBUS_INTERFACE_TEMPERATURE, temperature);
    step.out(SHEARBUS_OUTCOME, outcome).dt(kDt);
  }
};

const shearbus::Session::Law kOwnLaw = [](const shearbus_request& request) {
  for (std::size_t i = 0; i < request.n_outputs; ++i)
    if (request.outputs[i].field == SHEARBUS_SHEAR_STRESS)
      static_cast<double*>(request.outputs[i].values)[0] = 0.2 * request.inputs[1].values[0];
};

// The server is killed, and comes back after `away`: with a law that the user allows the host goes on, and every step
// is flagged and counted; without permission the step waits as ever. The layer has the steps that the server answered,
// and the one that it may have got, which is made once.
void fallback() {
  // The same steps without a pause.
  const auto after = [](int steps) {
    Sliding host;
    shearbus::Options given = options(1);
    given.check_closure = SHEARBUS_CHECK_OFF;
    shearbus::Session bus(given, {1});
    for (int step = 0; step < steps; ++step) bus.step(host.step);
    bus.close();
    return host.temperature[0];
  };

  std::string told;
  Sliding host;
  shearbus::Options given = options(1, &told);
  given.check_closure = SHEARBUS_CHECK_OFF;
  setenv("SHEARBUS_FALLBACK", "0.3 s", 1);
  {
    shearbus::Session bus(given, {1});
    REFUSED(bus.set_fallback(kOwnLaw), SHEARBUS_INVALID_VALUE, "SHEARBUS_FALLBACK is \"0.3 s\"");
    bus.close();
  }
  unsetenv("SHEARBUS_FALLBACK");
  {
    shearbus::Session bus(given, {1});
    bus.set_fallback(kOwnLaw);
    CHECK(bus.fallbacks().allowed == 0);
    bus.step(host.step);
    kill(pid_of_server(), SIGKILL);
    bus.step(host.step);  // waits for the server, as without a law
    CHECK(host.outcome[0] != SHEARBUS_OUTCOME_FALLBACK && bus.fallbacks().steps == 0);
    bus.close();
  }
  setenv("SHEARBUS_FALLBACK", "0.05", 1);
  told.clear();
  {
    shearbus::Session bus(given, {1});
    bus.set_fallback(kOwnLaw);
    CHECK(bus.fallbacks().allowed == 1);
    int answered = 0;
    for (; answered < 3; ++answered) bus.step(host.step);
    CHECK(host.outcome[0] == 0 && host.stress[0] > 0);
    const pid_t pid = pid_of_server();
    kill(pid, SIGKILL);
    int alone = 0;
    const double hot = host.temperature[0];
    const auto limit = std::chrono::steady_clock::now() + std::chrono::seconds(30);
    shearbus_result result = SHEARBUS_RESULT_INIT;
    do {
      result = bus.step(host.step);
      if (host.outcome[0] == SHEARBUS_OUTCOME_FALLBACK) {
        ++alone;
        CHECK(host.stress[0] == 0.2 * 5e8 && result.flagged_nodes == 1 && host.temperature[0] == hot);
      } else {
        ++answered;
      }
      usleep(1000);
    } while ((alone == 0 || host.outcome[0] != 0) && std::chrono::steady_clock::now() < limit);
    const shearbus_fallbacks totals = bus.fallbacks();
    CHECK(alone > 0 && host.outcome[0] == 0);
    CHECK(totals.steps == static_cast<std::uint64_t>(alone) && totals.node_steps == totals.steps &&
          totals.absences == 1);
    CHECK(std::fabs(totals.time_s - alone * kDt) < 1e-12 * totals.time_s);
    // The first step that found the server gone may have reached it: it is made once when the server is back.
    const double plain = after(answered), with_doubt = after(answered + 1);
    if (host.temperature[0] != plain && host.temperature[0] != with_doubt) {
      std::fprintf(stderr, "T0 %.12g after %d answered steps and %d alone, expected %.12g or %.12g\n",
                   host.temperature[0], answered, alone, plain, with_doubt);
      ++faults;
    }
    bus.mark("after");
    bus.close();
    std::ostringstream words;
    words << "the host's own law answered " << alone << " steps";
    for (const char* word : {"the host's own law answers instead of the server", "the server answers again"})
      CHECK(told.find(word) != std::string::npos);
    CHECK(told.find(words.str()) != std::string::npos);
    CHECK(told.find("closure:") == std::string::npos);
  }
  {  // a law that has no answer: the step fails as ever
    shearbus::Options hasty = given;
    shearbus::Session bus(hasty, {1});
    bus.set_fallback([](const shearbus_request&) { throw 1; });
    kill(pid_of_server(), SIGKILL);
    try {
      for (int step = 0; step < 3; ++step) bus.step(host.step);
    } catch (const shearbus::Error& fault) {
      CHECK(fault.code() == SHEARBUS_UNREACHABLE || fault.code() == SHEARBUS_UNKNOWN_OUTCOME);
    }
    CHECK(bus.fallbacks().steps == 0);
  }
  unsetenv("SHEARBUS_FALLBACK");
}

}  // namespace

int main(int count, char** arguments) try {
  if (count != 4) return 2;
  std::ifstream file(arguments[1]);
  std::ostringstream text;
  text << file.rdbuf();
  scene_text = text.str();
  endpoint = arguments[2];
  pid_file = arguments[3];
  for (const bool stick : {false, true}) {
    lumps(2, {0, 1, 0}, {1, 0, 0}, stick);
    lumps(2, {0.6, -0.8, 0}, {-0.8, -0.6, 0}, stick);
    lumps(3, {0, 0, 1}, {1, 0, 0}, stick);
    lumps(3, {0.48, 0.6, 0.64}, {0.8, 0, -0.6}, stick);
  }
  turning_plane();
  nodes_and_refusals();
  many_nodes();
  fallback();
  return faults == 0 ? 0 : 1;
} catch (const std::exception& fault) {
  std::fprintf(stderr, "%s\n", fault.what());
  return 1;
}
