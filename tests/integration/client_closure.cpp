// The closure check of the client library: a small host makes deliberate mistakes, and the warning must name each.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <string>
#include <vector>

#include "tests/support/running_server.hpp"
#include "tests/support/scenes.hpp"

namespace shearbus {
namespace {

using support::RunningServer;
using testing::AllOf;
using testing::AnyOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::StartsWith;

const std::vector<std::uint64_t> kNodes = support::node_ids(5);

// A pair of plates for each node. Each pair has its own far stresses, which accelerate it. ask() and apply() are those
// of a host without a mistake.
struct Host {
  std::vector<double> v_soft = {100.0, 40.0, 0.5, -60.0, 20.0}, v_hard = {0.0, 5.0, 0.0, 10.0, -3.0};
  double dt = 1e-9, time = 0.0;
  bool starts_at_rest = false;  // true: the first step has no far stresses

  double mass_soft(std::size_t i) const { return 0.0135 * (1.0 + 0.1 * static_cast<double>(i)); }
  double mass_hard(std::size_t i) const { return 0.0395 * (1.0 - 0.05 * static_cast<double>(i)); }
  double own() const { return starts_at_rest && time == 0.0 ? 0.0 : 1.0; }
  double stress_soft(std::size_t i) const { return own() * 2e8 * std::sin(1.0 + static_cast<double>(i) + 4e7 * time); }
  double stress_hard(std::size_t i) const { return own() * -1e8 * std::cos(2.0 * static_cast<double>(i) + 3e7 * time); }
  double jump(std::size_t i) const { return v_soft[i] - v_hard[i]; }
  double without_friction(std::size_t i) const {  // the jump after the forces of this step
    return jump(i) + dt * (stress_soft(i) / mass_soft(i) + stress_hard(i) / mass_hard(i));
  }

  void ask(Batch& request) const {
    const bool sticks = request.has(Field::kImpedance);
    for (std::size_t i = 0; i < kNodes.size(); ++i) {
      request.f64(Field::kVelocityJump)[i] = jump(i);
      request.f64(Field::kPressure)[i] = 4e8;
      if (sticks) {
        const double Z = 1.0 / (dt * (1.0 / mass_soft(i) + 1.0 / mass_hard(i)));
        request.f64(Field::kImpedance)[i] = Z;
        request.f64(Field::kStickStress)[i] =
            Z * (jump(i) + dt * (stress_soft(i) / mass_soft(i) + stress_hard(i) / mass_hard(i)));
      } else {
        request.f64(Field::kStressSoft)[i] = stress_soft(i);
        request.f64(Field::kStressHard)[i] = stress_hard(i);
        request.f64(Field::kMassSoft)[i] = mass_soft(i);
        request.f64(Field::kMassHard)[i] = mass_hard(i);
      }
    }
  }
  // `to_soft`, `to_hard`: share of the stress that acts on the soft and on the hard plate; 1 without a mistake.
  void apply(std::span<const double> stress, double to_soft = 1.0, double to_hard = 1.0) {
    for (std::size_t i = 0; i < kNodes.size(); ++i) {
      v_soft[i] += dt * (stress_soft(i) - to_soft * stress[i]) / mass_soft(i);
      v_hard[i] += dt * (to_hard * stress[i] - stress_hard(i)) / mass_hard(i);
    }
    time += dt;
  }
};

void scale(Batch& request, Field field, double factor) {
  for (double& value : request.f64(field)) value *= factor;
}

// Of one node: the jump, that of the step before, and the jumps of both steps after their forces without friction.
struct Levels {
  double now, before, free_now, free_before;
};

struct Mistake {
  const char* name;
  const char* named;  // text that the warning must contain; null: no warning
  std::function<void(Batch&)> in_request;
  double to_soft = 1.0, to_hard = 1.0;
  std::function<double(const Host&, int step)> dt_sent;  // dt that the host sends; absent: its own dt
  std::function<double(int step)> dt;                    // dt of each step of the host; absent: always the same dt
  bool unique = true;                                    // true: the warning must name one mistake only
  std::function<double(const Levels&)> level;            // jump that the host sends; absent: its own jump
  bool starts_at_rest = false;
};

struct Run {
  std::vector<std::string> warnings;
  double closure = 0.0;  // largest closure_m_per_s (jump sent minus jump answered before) of the first 3 steps  [m/s]
};

Run run(RunningServer& server, const Mistake& mistake, Form form) {
  Run run;
  ClientOptions options = server.client_options("inproc");
  options.check_closure = CheckClosure::kWarn;
  options.log = [&](const std::string& line) { run.warnings.push_back(line); };
  Client client(options);
  Session session = client.open(support::text_of(support::force_scene()), "scene", kNodes);
  Host host{.starts_at_rest = mistake.starts_at_rest};
  Host before = host;
  Batch request = session.request({}, form);
  for (int step = 0; step < 8; ++step) {
    if (mistake.dt) host.dt = mistake.dt(step);
    host.ask(request);
    for (std::size_t i = 0; mistake.level && i < kNodes.size(); ++i)
      request.f64(Field::kVelocityJump)[i] =
          mistake.level({.now = host.jump(i),
                         .before = before.jump(i),
                         .free_now = host.without_friction(i),
                         .free_before = step == 0 ? host.jump(i) : before.without_friction(i)});
    if (mistake.in_request) mistake.in_request(request);
    const StepResult& result =
        session.advance(request, {.dt_s = mistake.dt_sent ? mistake.dt_sent(host, step) : host.dt});
    if (step < 3) run.closure = std::max(run.closure, result.upscale().largest_closure_m_per_s);
    before = host;
    host.apply(result.shear_stress_pa(), mistake.to_soft, mistake.to_hard);
  }
  session.close();
  return run;
}

void expect_named(RunningServer& server, std::span<const Mistake> mistakes, Form form) {
  for (const Mistake& mistake : mistakes) {
    SCOPED_TRACE(mistake.name);
    const Run found = run(server, mistake, form);
    const std::string text = found.warnings.empty() ? "-" : found.warnings[0];
    const std::size_t named = text.find("explains it: ");
    std::printf("%-58s %9.2e m/s  %s\n", mistake.name, found.closure,
                named == std::string::npos ? text.c_str() : text.c_str() + named + 13);
    if (mistake.named == nullptr) {
      EXPECT_THAT(found.warnings, IsEmpty());
      EXPECT_LT(found.closure, 1e-10);
      continue;
    }
    ASSERT_THAT(found.warnings, ElementsAre(StartsWith("warning: closure: the host brings a jump of "))) << "once";
    EXPECT_THAT(text, HasSubstr(mistake.named));
    EXPECT_EQ(text.find("; or: ") == std::string::npos, mistake.unique) << text;
    EXPECT_GT(found.closure, 1e-3);
  }
}

double varying(int step) {
  return 1e-9 * (1.0 + 0.05 * step);
}

TEST(ClientClosure, NamesTheMistakeOfAFarFieldHost) {
  RunningServer server;
  const auto times = [](Field field, double factor) { return [=](Batch& b) { scale(b, field, factor); }; };
  const auto masses = [](double factor) {
    return [=](Batch& b) {
      scale(b, Field::kMassSoft, factor);
      scale(b, Field::kMassHard, factor);
    };
  };
  const auto both_signs = [](Batch& b) {
    scale(b, Field::kStressSoft, -1.0);
    scale(b, Field::kStressHard, -1.0);
  };
  const auto swap = [](Field one, Field other) {
    return [=](Batch& b) { std::ranges::swap_ranges(b.f64(one), b.f64(other)); };
  };
  const char* kHeavy = "both masses must be half of those sent, or dt_s twice that sent";
  const char* kLight = "both masses must be twice those sent, or dt_s half of that sent";
  const Mistake mistakes[] = {
      {.name = "none", .named = nullptr},
      {.name = "none, dt varies", .named = nullptr, .dt = varying},
      {.name = "stress_soft of the wrong sign",
       .named = "stress_soft has the wrong sign",
       .in_request = times(Field::kStressSoft, -1.0)},
      {.name = "stress_hard of the wrong sign",
       .named = "stress_hard has the wrong sign",
       .in_request = times(Field::kStressHard, -1.0)},
      {.name = "both stresses of the wrong sign", .named = "both have the wrong sign", .in_request = both_signs},
      {.name = "jump of the wrong sign",
       .named = "velocity_jump has the wrong sign",
       .in_request = times(Field::kVelocityJump, -1.0)},
      {.name = "stresses of the sides swapped",
       .named = "are swapped",
       .in_request = swap(Field::kStressSoft, Field::kStressHard)},
      {.name = "masses of the sides swapped",
       .named = "are swapped",
       .in_request = swap(Field::kMassSoft, Field::kMassHard)},
      {.name = "answer applied with the wrong sign",
       .named = "applied with the wrong sign",
       .to_soft = -1.0,
       .to_hard = -1.0},
      {.name = "answer applied to the soft body only", .named = "to the soft body only", .to_hard = 0.0},
      {.name = "answer applied to the hard body only", .named = "to the hard body only", .to_soft = 0.0},
      {.name = "answer not applied", .named = "is not applied", .to_soft = 0.0, .to_hard = 0.0},
      {.name = "masses of whole zones", .named = kHeavy, .in_request = masses(2.0)},
      {.name = "masses of quarter zones", .named = kLight, .in_request = masses(0.5)},
      {.name = "dt half of the step", .named = kHeavy, .dt_sent = [](const Host& h, int) { return 0.5 * h.dt; }},
      {.name = "mass of the whole soft zone",
       .named = "mass_soft must be half of that sent",
       .in_request = times(Field::kMassSoft, 2.0)},
      {.name = "mass of the whole hard zone",
       .named = "mass_hard must be half of that sent",
       .in_request = times(Field::kMassHard, 2.0)},
      {.name = "dt of the step before",
       .named = "advance by the dt_s of this step",
       .dt_sent = [](const Host&, int step) { return varying(step - 1); },
       .dt = varying},
      {.name = "dt of the next step",
       .named = "advance by the dt_s of the step before the last one",
       .dt_sent = [](const Host&, int step) { return varying(step + 1); },
       .dt = [](int step) { return step < 1 ? varying(1) : varying(step); }},
      {.name = "dt of the positions before, n-1 to n",
       .named = "dt_s is the step of the positions before",
       .dt_sent = [](const Host&, int step) { return varying(step); },
       .dt = [](int step) { return 0.5 * (varying(step) + varying(step + 1)); }},
      {.name = "none, from rest", .named = nullptr, .starts_at_rest = true},
      {.name = "jump of the step before",
       .named = "the jump sent is that of an earlier step",
       .level = [](const Levels& jump) { return jump.before; }},
      {.name = "jump without the last friction",
       .named = "the jump sent is that without the friction of the last step",
       .level = [](const Levels& jump) { return jump.free_before; }},
      {.name = "jump after the forces of this step",
       .named = "the jump sent is that after the forces of this step",
       .level = [](const Levels& jump) { return jump.free_now; }},
      // From rest these are one in the second step: the third tells them apart.
      {.name = "answer not applied, from rest",
       .named = "is not applied",
       .to_soft = 0.0,
       .to_hard = 0.0,
       .starts_at_rest = true},
      {.name = "jump of the step before, from rest",
       .named = "the jump sent is that of an earlier step",
       .level = [](const Levels& jump) { return jump.before; },
       .starts_at_rest = true},
      {.name = "jump without the last friction, from rest",
       .named = "the jump sent is that without the friction of the last step",
       .level = [](const Levels& jump) { return jump.free_before; },
       .starts_at_rest = true},
      {.name = "first kick a whole step",
       .named = "if your first kick is a whole step, send its length",
       .dt_sent = [](const Host& h, int step) { return (step == 0 ? 0.5 : 1.0) * h.dt; }},
      {.name = "jump in km/s", .named = "it looks like km/s or mm/us", .in_request = times(Field::kVelocityJump, 1e-3)},
      {.name = "jump in cm/s", .named = "it looks like cm/s", .in_request = times(Field::kVelocityJump, 1e2)},
      {.name = "two mistakes", .named = "No single mistake", .in_request = both_signs, .to_hard = 0.0},
  };
  expect_named(server, mistakes, Form::kFarField);
}

TEST(ClientClosure, NamesTheMistakeOfAStickHost) {
  RunningServer server;
  const auto times = [](Field field, double factor) { return [=](Batch& b) { scale(b, field, factor); }; };
  // A wrong impedance makes two columns wrong, because the host multiplies by it to get the stick stress.
  const auto impedance = [](double factor) {
    return [=](Batch& b) {
      scale(b, Field::kImpedance, factor);
      scale(b, Field::kStickStress, factor);
    };
  };
  const Mistake mistakes[] = {
      {.name = "none", .named = nullptr},
      {.name = "dt of the layer is not that of the momentum",
       .named = nullptr,
       .dt_sent = [](const Host& h, int) { return 2.0 * h.dt; }},
      {.name = "stick stress of the wrong sign",
       .named = "stick_stress has the wrong sign",
       .in_request = times(Field::kStickStress, -1.0)},
      {.name = "jump of the wrong sign",
       .named = "velocity_jump has the wrong sign",
       .in_request = times(Field::kVelocityJump, -1.0)},
      {.name = "stick stress without the old jump",
       .named = "lacks the part of the old jump",
       .in_request =
           [](Batch& b) {
             for (std::size_t i = 0; i < kNodes.size(); ++i)
               b.f64(Field::kStickStress)[i] -= b.f64(Field::kImpedance)[i] * b.f64(Field::kVelocityJump)[i];
           }},
      {.name = "answer applied with the wrong sign",
       .named = "applied with the wrong sign",
       .to_soft = -1.0,
       .to_hard = -1.0},
      {.name = "answer not applied", .named = "is not applied", .to_soft = 0.0, .to_hard = 0.0},
      {.name = "jump of the step before",
       .named = "the jump sent is that of an earlier step",
       .level = [](const Levels& jump) { return jump.before; }},
      {.name = "jump after the forces of this step",
       .named = "the jump sent is that after the forces of this step",
       .level = [](const Levels& jump) { return jump.free_now; }},
      {.name = "impedance of half zones twice as heavy",
       .named = "impedance must be half of that sent",
       .in_request = impedance(2.0)},
      {.name = "impedance alone twice as large, as one without the gamma of a Newmark scheme",
       .named = "impedance alone must be half of that sent",
       .in_request = times(Field::kImpedance, 2.0)},
      {.name = "impedance alone half",
       .named = "impedance alone must be twice",
       .in_request = times(Field::kImpedance, 0.5)},
      {.name = "stick stress of a fault without its initial stress",
       .named = "is stick_stress the total one",
       .in_request =
           [](Batch& b) {
             for (double& stress : b.f64(Field::kStickStress)) stress -= 3e7;
           }},
      {.name = "impedance half",
       .named = "impedance must be twice that sent, or the answered stress is applied to one side only",
       .in_request = impedance(0.5)},
      {.name = "jump of a Newmark predictor: the step moves the jump by half of what it moves it to the next request",
       .named = "predictor of a Newmark scheme",
       .in_request =
           [](Batch& b) {
             for (std::size_t i = 0; i < kNodes.size(); ++i) {
               b.f64(Field::kStickStress)[i] += b.f64(Field::kImpedance)[i] * b.f64(Field::kVelocityJump)[i];
               b.f64(Field::kImpedance)[i] *= 2.0;
             }
           }},
  };
  expect_named(server, mistakes, Form::kStick);
}

// Where units are in doubt no other mistake is named: a sum of metres and nodes looks like many of them.
TEST(ClientClosure, WaitsForUnitsBeforeItNamesAMistake) {
  RunningServer server;
  const auto per_node = [](Batch& b) {
    for (const Field field : {Field::kMassSoft, Field::kMassHard, Field::kStickStress, Field::kImpedance})
      if (b.has(field)) scale(b, field, 1e-6);
  };
  for (const Form form : {Form::kFarField, Form::kStick}) {
    const struct Run found = run(server, {.name = "per node", .named = "", .in_request = per_node}, form);
    ASSERT_THAT(found.warnings,
                ElementsAre(AnyOf(HasSubstr("mass_soft_kg_per_m2: "), HasSubstr("impedance_pa_s_per_m: ")),
                            AllOf(HasSubstr("closure: "), HasSubstr("correct these first"))));
    EXPECT_THAT(found.warnings[0], HasSubstr("per area"));
  }
}

// The host makes trial steps and rejects some of them. Its later steps name some of the nodes, each in another order.
TEST(ClientClosure, FollowsTrialsRollbacksMarksAndSubsets) {
  RunningServer server;
  ClientOptions options = server.client_options("inproc");
  options.check_closure = CheckClosure::kError;
  Client client(options);
  Session session = client.open(support::text_of(support::force_scene()), "scene", kNodes);
  Host host;
  Batch request = session.request();
  const auto step = [&](auto&& advance) {
    host.ask(request);
    const StepResult& result = advance();
    host.apply(result.shear_stress_pa());
  };
  step([&]() -> const StepResult& { return session.advance(request, {.dt_s = host.dt}); });
  const Host marked = host;
  session.mark("here");
  for (int round = 0; round < 3; ++round) {
    host.ask(request);
    session.trial(request, {.dt_s = 3.0 * host.dt});
    session.rollback();
    step([&]() -> const StepResult& { return session.trial(request, {.dt_s = host.dt}); });
    step([&]() -> const StepResult& { return session.trial(request, {.dt_s = host.dt, .commit_previous = true}); });
    session.commit();
  }
  host = marked;
  session.rollback_to("here");
  step([&]() -> const StepResult& { return session.advance(request, {.dt_s = host.dt}); });
  for (const std::vector<std::size_t>& order : {std::vector<std::size_t>{3, 1}, {1, 3}, {1, 0, 2}}) {
    std::vector<std::uint64_t> ids;
    for (const std::size_t i : order) ids.push_back(kNodes[i]);
    Batch some = session.request_for(ids);
    host.ask(request);
    for (const wire::Column& column : request.columns())
      for (std::size_t row = 0; row < order.size(); ++row)
        some.f64(column.field)[row] = request.f64(column.field)[order[row]];
    const StepResult& result = session.advance(some, {.dt_s = host.dt});
    std::vector<double> stress(kNodes.size(), 0.0);
    for (std::size_t row = 0; row < order.size(); ++row) stress[order[row]] = result.shear_stress_pa()[row];
    host.apply(stress);
  }
}

TEST(ClientClosure, AnErrorIsThrownBeforeTheStepIsSent) {
  RunningServer server;
  ClientOptions options = server.client_options("inproc");
  options.check_closure = CheckClosure::kError;
  Client client(options);
  Session session = client.open(support::text_of(support::force_scene()), "scene", kNodes);
  Host host;
  Batch request = session.request();
  for (int step = 0; step < 130; ++step) {
    host.ask(request);
    host.apply(session.advance(request, {.dt_s = host.dt}).shear_stress_pa());
  }
  host.v_hard[1] += 0.25;
  host.ask(request);
  try {
    session.advance(request, {.dt_s = host.dt});
    FAIL() << "a jump of another cause went through";
  } catch (const Error& fault) {
    EXPECT_EQ(fault.status().code, Code::kNotClosed);
    EXPECT_THAT(fault.status().text, HasSubstr("node 101"));
    EXPECT_THAT(fault.status().text, HasSubstr("1 of 5 nodes differ, this one by -0.25 m/s"));
  }
  host.v_hard[1] -= 0.25;
  host.ask(request);
  EXPECT_EQ(session.advance(request, {.dt_s = host.dt}).upscale().state_version, 131U);
}

// A warning that waits for another step is shown at the end of the session; in mode kError nothing waits.
TEST(ClientClosure, AlternativesAreAllNamedWhereNoFurtherStepTells) {
  for (const CheckClosure mode : {CheckClosure::kWarn, CheckClosure::kError}) {
    RunningServer server;
    std::vector<std::string> said;
    ClientOptions options = server.client_options("inproc");
    options.check_closure = mode;
    options.log = [&](const std::string& line) { said.push_back(line); };
    Client client(options);
    Session session = client.open(support::text_of(support::force_scene()), "scene", kNodes);
    Host host{.starts_at_rest = true};
    Batch request = session.request();
    for (int step = 0; step < 2; ++step) {
      host.ask(request);
      try {
        host.apply(session.advance(request, {.dt_s = host.dt}).shear_stress_pa(), 0.0, 0.0);
      } catch (const Error& fault) {
        said.push_back(fault.status().text);
        EXPECT_THAT(fault.status().remedy, HasSubstr("check_closure = 'warn'"));
      }
    }
    EXPECT_EQ(said.size(), mode == CheckClosure::kError ? 1U : 0U);
    session.close();
    ASSERT_EQ(said.size(), 1U);
    EXPECT_THAT(said[0], HasSubstr("the answered stress is not applied; or: the jump sent is that of an earlier step"));
    EXPECT_THAT(said[0], HasSubstr("; or: the jump sent is that without the friction of the last step"));
  }
}

// Both strategies; a session that was resumed after its first steps begins with no contact or unit of its own.
TEST(ClientClosure, DoubtfulInputsOfASessionAreNamedOnce) {
  for (const bool force_driven : {true, false}) {
    RunningServer server;
    std::vector<std::string> said;
    ClientOptions options = server.client_options("inproc");
    options.check_closure = CheckClosure::kWarn;
    options.log = [&](const std::string& line) { said.push_back(line); };
    Client client(options);
    const auto scene = support::text_of(force_driven ? support::force_scene() : support::velocity_scene());
    const auto play = [&](Session& session, double pressure, double dt, int steps) {
      Host host{.dt = dt};
      Batch request = session.request();
      for (int step = 0; step < steps; ++step) {
        if (force_driven) host.ask(request);
        for (std::size_t i = 0; i < kNodes.size(); ++i) {
          request.f64(Field::kVelocityJump)[i] = host.jump(i);
          request.f64(Field::kPressure)[i] = pressure;
        }
        const StepResult& result = session.advance(request, {.dt_s = host.dt});
        if (force_driven) host.apply(result.shear_stress_pa());
      }
    };
    for (const auto& [pressure, text] : {std::pair(11'200.0, "warning: pressure_pa: the highest pressure of the first"),
                                         std::pair(-2e9, "warning: pressure_pa: no node was ever in contact in 12")}) {
      said.clear();
      Session session = client.open(scene, "scene", kNodes);
      play(session, pressure, 1e-9, 12);
      session.close();
      EXPECT_THAT(said, ElementsAre(StartsWith(text)));
    }
    said.clear();
    Session session = client.open(scene, "scene", kNodes);
    play(session, 4e8, 1e-9, 12);
    const Session::Ticket ticket = session.ticket();
    session.leave();
    Session later = client.resume(ticket);
    Batch request = later.request();
    for (double& value : request.f64(Field::kPressure)) value = -1e8;
    if (force_driven)
      for (const Field mass : {Field::kMassSoft, Field::kMassHard}) std::ranges::fill(request.f64(mass), 0.01);
    later.advance(request, {.dt_s = 1e-9});
    later.close();
    EXPECT_THAT(said, IsEmpty());
  }
}

TEST(ClientClosure, WatchesTheFirstHundredStepsAndPassesOnWhatTheServerSaysOnce) {
  RunningServer server;
  std::vector<std::string> warnings;
  ClientOptions options = server.client_options("inproc");
  options.check_closure = CheckClosure::kWarn;
  options.log = [&](const std::string& line) { warnings.push_back(line); };
  Client client(options);
  Session session = client.open(support::text_of(support::force_scene()), "scene", kNodes);
  Host host;
  Batch request = session.request();
  for (int step = 0; step < 110; ++step) {
    host.ask(request);
    const StepResult& result = session.advance(request, {.dt_s = host.dt, .time_s = 2.0 * (host.time + host.dt)});
    host.apply(result.shear_stress_pa());
    if (step == 104) host.v_soft[0] += 1.0;
  }
  EXPECT_THAT(warnings, ElementsAre(StartsWith("warning: time_s: the host's time grew by 2")));
}

}  // namespace
}  // namespace shearbus
