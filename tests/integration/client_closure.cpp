// The closure check of the client library: a small host makes deliberate mistakes, and the warning must name each.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <string>
#include <vector>

#include "tests/support/refused.hpp"
#include "tests/support/running_server.hpp"
#include "tests/support/scenes.hpp"
#include "tests/support/step_request.hpp"

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

// A client that checks closure, its session and a host that applies its answers.
struct Coupled {
  Coupled(RunningServer& server, CheckClosure check, bool starts_at_rest = false, Form form = Form::kFarField)
      : client(options(server, check)),
        session(client.open(support::text_of(support::force_scene()), "scene", kNodes)),
        host{.starts_at_rest = starts_at_rest},
        request(support::step_request(session, form)) {}

  ClientOptions options(RunningServer& server, CheckClosure check) {
    ClientOptions options = server.client_options("inproc");
    options.check_closure = check;
    options.log = [this](const std::string& line) { said.push_back(line); };
    return options;
  }
  const StepResult& step() {
    host.ask(request);
    const StepResult& result = session.advance(request, {.dt_s = host.dt});
    host.apply(result.shear_stress_pa());
    return result;
  }

  std::vector<std::string> said;
  Client client;
  Session session;
  Host host;
  Batch request;
};

struct Run {
  std::vector<std::string> warnings;
  double closure = 0.0;  // largest closure_m_per_s (jump sent minus jump answered before) of the first 3 steps  [m/s]
};

Run run(RunningServer& server, const Mistake& mistake, Form form) {
  double closure = 0.0;
  Coupled coupled(server, CheckClosure::kWarn, mistake.starts_at_rest, form);
  Host& host = coupled.host;
  Batch& request = coupled.request;
  Host before = host;
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
        coupled.session.advance(request, {.dt_s = mistake.dt_sent ? mistake.dt_sent(host, step) : host.dt});
    if (step < 3) closure = std::max(closure, result.upscale().largest_closure_m_per_s);
    before = host;
    host.apply(result.shear_stress_pa(), mistake.to_soft, mistake.to_hard);
  }
  coupled.session.close();
  return {coupled.said, closure};
}

void expect_named(RunningServer& server, std::span<const Mistake> mistakes, Form form) {
  for (const Mistake& mistake : mistakes) {
    SCOPED_TRACE(mistake.name);
    const Run found = run(server, mistake, form);
    const std::string text = found.warnings.empty() ? "-" : found.warnings[0];
    constexpr std::string_view kNamed = "One change could explain it: ";
    const std::size_t named = text.find(kNamed);
    std::printf("%-58s %9.2e m/s  %s\n", mistake.name, found.closure,
                named == std::string::npos ? text.c_str() : text.c_str() + named + kNamed.size());
    if (mistake.named == nullptr) {
      EXPECT_THAT(found.warnings, IsEmpty());
      EXPECT_LT(found.closure, 1e-10);
      continue;
    }
    ASSERT_THAT(found.warnings, ElementsAre(StartsWith("warning: closure: the host brings a jump of "))) << "once";
    EXPECT_THAT(text, HasSubstr(mistake.named));
    EXPECT_NE(named == std::string::npos, text.find("No single mistake") == std::string::npos) << text;
    EXPECT_EQ(text.find("; or: ") == std::string::npos, mistake.unique) << text;
    EXPECT_GT(found.closure, 1e-3);
  }
}

double varying(int step) {
  return 1e-9 * (1.0 + 0.05 * step);
}

// Mistakes in what is sent, in what is done with the answer, and in the level of the jump.
using Change = std::function<void(Batch&)>;
Mistake sent(const char* name, const char* named, Change change) {
  return {.name = name, .named = named, .in_request = std::move(change)};
}
Mistake applied(const char* name, const char* named, double to_soft, double to_hard, bool from_rest = false) {
  return {.name = name, .named = named, .to_soft = to_soft, .to_hard = to_hard, .starts_at_rest = from_rest};
}
Mistake jump_of(const char* name, const char* named, double Levels::*level, bool from_rest = false) {
  return {.name = name,
          .named = named,
          .level = [level](const Levels& jump) { return jump.*level; },
          .starts_at_rest = from_rest};
}

Change times(std::initializer_list<Field> fields, double factor) {
  return [fields = std::vector(fields), factor](Batch& batch) {
    for (const Field field : fields)
      for (double& value : batch.f64(field)) value *= factor;
  };
}
Change swapped(Field one, Field other) {
  return [=](Batch& batch) { std::ranges::swap_ranges(batch.f64(one), batch.f64(other)); };
}

constexpr const char* kWrongSign = "applied with the wrong sign";
constexpr const char* kNotApplied = "is not applied";
constexpr const char* kEarlier = "the jump sent is that of an earlier step";
constexpr const char* kWithoutFriction = "the jump sent is that without the friction of the last step";
constexpr const char* kAfterForces = "the jump sent is that after the forces of this step";

TEST(ClientClosure, NamesTheMistakeOfAFarFieldHost) {
  RunningServer server;
  const auto masses = {Field::kMassSoft, Field::kMassHard};
  const Change both_signs = times({Field::kStressSoft, Field::kStressHard}, -1.0);
  const char* kHeavy = "both masses must be half of those sent, or dt_s twice that sent";
  const char* kLight = "both masses must be twice those sent, or dt_s half of that sent";
  const Mistake mistakes[] = {
      {.name = "none", .named = nullptr},
      {.name = "none, dt varies", .named = nullptr, .dt = varying},
      sent("stress_soft of the wrong sign", "stress_soft has the wrong sign", times({Field::kStressSoft}, -1.0)),
      sent("stress_hard of the wrong sign", "stress_hard has the wrong sign", times({Field::kStressHard}, -1.0)),
      sent("both stresses of the wrong sign", "both have the wrong sign", both_signs),
      sent("jump of the wrong sign", "velocity_jump has the wrong sign", times({Field::kVelocityJump}, -1.0)),
      sent("stresses of the sides swapped", "are swapped", swapped(Field::kStressSoft, Field::kStressHard)),
      sent("masses of the sides swapped", "are swapped", swapped(Field::kMassSoft, Field::kMassHard)),
      applied("answer applied with the wrong sign", kWrongSign, -1.0, -1.0),
      applied("answer applied to the soft body only", "to the soft body only", 1.0, 0.0),
      applied("answer applied to the hard body only", "to the hard body only", 0.0, 1.0),
      applied("answer not applied", kNotApplied, 0.0, 0.0),
      sent("masses of whole zones", kHeavy, times(masses, 2.0)),
      sent("masses of quarter zones", kLight, times(masses, 0.5)),
      {.name = "dt half of the step", .named = kHeavy, .dt_sent = [](const Host& h, int) { return 0.5 * h.dt; }},
      sent("mass of the whole soft zone", "mass_soft must be half of that sent", times({Field::kMassSoft}, 2.0)),
      sent("mass of the whole hard zone", "mass_hard must be half of that sent", times({Field::kMassHard}, 2.0)),
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
      jump_of("jump of the step before", kEarlier, &Levels::before),
      jump_of("jump without the last friction", kWithoutFriction, &Levels::free_before),
      jump_of("jump after the forces of this step", kAfterForces, &Levels::free_now),
      // From rest these are one in the second step: the third tells them apart.
      applied("answer not applied, from rest", kNotApplied, 0.0, 0.0, true),
      jump_of("jump of the step before, from rest", kEarlier, &Levels::before, true),
      jump_of("jump without the last friction, from rest", kWithoutFriction, &Levels::free_before, true),
      {.name = "first kick a whole step",
       .named = "if your first kick is a whole step, send its length",
       .dt_sent = [](const Host& h, int step) { return (step == 0 ? 0.5 : 1.0) * h.dt; }},
      sent("jump in km/s", "it looks like km/s or mm/us", times({Field::kVelocityJump}, 1e-3)),
      sent("jump in cm/s", "it looks like cm/s", times({Field::kVelocityJump}, 1e2)),
      sent("jump in cm/us", "it looks like cm/us", times({Field::kVelocityJump}, 1e-4)),
      sent("masses in g/cm2", "it looks like that of g/cm2", times(masses, 0.1)),
      {.name = "two mistakes", .named = "No single mistake", .in_request = both_signs, .to_hard = 0.0},
  };
  expect_named(server, mistakes, Form::kFarField);
}

TEST(ClientClosure, NamesTheMistakeOfAStickHost) {
  RunningServer server;
  // A wrong impedance makes two columns wrong, because the host multiplies by it to get the stick stress.
  const auto both = {Field::kImpedance, Field::kStickStress};
  // Adds `factor` times the impedance times the old jump to the stick stress.
  const auto add_jump = [](Batch& batch, double factor) {
    for (std::size_t i = 0; i < kNodes.size(); ++i)
      batch.f64(Field::kStickStress)[i] +=
          factor * batch.f64(Field::kImpedance)[i] * batch.f64(Field::kVelocityJump)[i];
  };
  const Mistake mistakes[] = {
      {.name = "none", .named = nullptr},
      {.name = "dt of the layer is not that of the momentum",
       .named = nullptr,
       .dt_sent = [](const Host& h, int) { return 2.0 * h.dt; }},
      sent("stick stress of the wrong sign", "stick_stress has the wrong sign", times({Field::kStickStress}, -1.0)),
      sent("jump of the wrong sign", "velocity_jump has the wrong sign", times({Field::kVelocityJump}, -1.0)),
      sent("stick stress without the old jump", "lacks the part of the old jump",
           [&](Batch& batch) { add_jump(batch, -1.0); }),
      applied("answer applied with the wrong sign", kWrongSign, -1.0, -1.0),
      applied("answer not applied", kNotApplied, 0.0, 0.0),
      jump_of("jump of the step before", kEarlier, &Levels::before),
      jump_of("jump after the forces of this step", kAfterForces, &Levels::free_now),
      sent("impedance of half zones twice as heavy", "impedance must be half of that sent", times(both, 2.0)),
      sent("impedance alone twice as large, as one without the gamma of a Newmark scheme",
           "impedance alone must be half of that sent", times({Field::kImpedance}, 2.0)),
      sent("impedance alone half", "impedance alone must be twice", times({Field::kImpedance}, 0.5)),
      sent("stick stress of a fault without its initial stress", "is stick_stress the total one",
           [](Batch& batch) {
             for (double& stress : batch.f64(Field::kStickStress)) stress -= 3e7;
           }),
      sent("impedance half", "impedance must be twice that sent, or the answered stress is applied to one side only",
           times(both, 0.5)),
      sent("impedance of masses in g/cm2", "it looks like that of g/cm2", times(both, 0.1)),
      sent("jump of a Newmark predictor: the step moves the jump by half of what it moves it to the next request",
           "predictor of a Newmark scheme",
           [&](Batch& batch) {
             add_jump(batch, 1.0);
             times({Field::kImpedance}, 2.0)(batch);
           }),
  };
  expect_named(server, mistakes, Form::kStick);
}

TEST(ClientClosure, NamesRowsInAnotherOrder) {
  RunningServer server;
  for (const Form form : {Form::kFarField, Form::kStick}) {
    Coupled coupled(server, CheckClosure::kWarn, false, form);
    coupled.step();
    std::ranges::reverse(coupled.host.v_soft);
    std::ranges::reverse(coupled.host.v_hard);
    coupled.step();
    EXPECT_THAT(coupled.said, ElementsAre(HasSubstr("explain it: these are the jumps answered, in another order")));
    coupled.session.close();
  }
}

// Where units are in doubt no other mistake is named: a sum of metres and nodes looks like many of them.
TEST(ClientClosure, WaitsForUnitsBeforeItNamesAMistake) {
  RunningServer server;
  const auto per_node = [](Batch& b) {
    for (const Field field : {Field::kMassSoft, Field::kMassHard, Field::kStickStress, Field::kImpedance})
      if (b.has(field)) times({field}, 1e-6)(b);
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
  Coupled coupled(server, CheckClosure::kError);
  Session& session = coupled.session;
  Host& host = coupled.host;
  Batch& request = coupled.request;
  const auto step = [&](auto&& advance) {
    host.ask(request);
    const StepResult& result = advance();
    host.apply(result.shear_stress_pa());
  };
  coupled.step();
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
  coupled.step();
  for (const std::vector<std::size_t>& order : {std::vector<std::size_t>{3, 1}, {1, 3}, {1, 0, 2}}) {
    std::vector<std::uint64_t> ids;
    for (const std::size_t i : order) ids.push_back(kNodes[i]);
    Batch some = support::step_request(session, Form::kFarField, ids);
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
  Coupled coupled(server, CheckClosure::kError);
  Session& session = coupled.session;
  Host& host = coupled.host;
  Batch& request = coupled.request;
  for (int step = 0; step < 130; ++step) coupled.step();
  host.v_hard[1] += 0.25;
  host.ask(request);
  const Status fault = support::fault_of([&] { session.advance(request, {.dt_s = host.dt}); });
  EXPECT_EQ(fault.code, Code::kNotClosed) << "a jump of another cause";
  EXPECT_THAT(fault.text, AllOf(HasSubstr("node 101"), HasSubstr("1 of 5 nodes differ, this one by -0.25 m/s")));
  host.v_hard[1] -= 0.25;
  host.ask(request);
  EXPECT_EQ(session.advance(request, {.dt_s = host.dt}).upscale().state_version, 131U);
}

// A warning that waits for another step is shown at the end of the session; in mode kError nothing waits.
TEST(ClientClosure, AlternativesAreAllNamedWhereNoFurtherStepTells) {
  for (const CheckClosure mode : {CheckClosure::kWarn, CheckClosure::kError}) {
    RunningServer server;
    Coupled coupled(server, mode, true);
    std::vector<std::string>& said = coupled.said;
    Session& session = coupled.session;
    Host& host = coupled.host;
    Batch& request = coupled.request;
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
      Batch request = support::step_request(session);
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
    Batch request = support::step_request(later);
    for (double& value : request.f64(Field::kPressure)) value = -1e8;
    if (force_driven)
      for (const Field mass : {Field::kMassSoft, Field::kMassHard}) std::ranges::fill(request.f64(mass), 0.01);
    later.advance(request, {.dt_s = 1e-9});
    later.close();
    EXPECT_EQ(said.size(), force_driven ? 1U : 0U) << "a host whose jumps are all 0 is not where it was";
  }
}

TEST(ClientClosure, WatchesTheFirstHundredStepsAndPassesOnWhatTheServerSaysOnce) {
  RunningServer server;
  Coupled coupled(server, CheckClosure::kWarn);
  Session& session = coupled.session;
  Host& host = coupled.host;
  Batch& request = coupled.request;
  for (int step = 0; step < 110; ++step) {
    host.ask(request);
    const StepResult& result = session.advance(request, {.dt_s = host.dt, .time_s = 2.0 * (host.time + host.dt)});
    host.apply(result.shear_stress_pa());
    if (step == 104) host.v_soft[0] += 1.0;
  }
  EXPECT_THAT(coupled.said,
              ElementsAre(StartsWith("warning: time_s: the host's time grew by 2"),
                          StartsWith("warning: closure: the host brought a jump for node 100 that is 1 m/s")));
}

// The layers go back to a mark, and the host does not: the first step from there is not compared before it is sent.
TEST(ClientClosure, TheServerTellsOfAStepThatWasNotCompared) {
  RunningServer server;
  for (const CheckClosure check : {CheckClosure::kWarn, CheckClosure::kError}) {
    Coupled coupled(server, check);
    coupled.step();
    coupled.session.mark("here");
    const Host marked = coupled.host;
    for (int step = 0; step < 3; ++step) coupled.step();
    coupled.session.rollback_to("here");
    coupled.step();
    if (check == CheckClosure::kWarn) {
      coupled.step();
      EXPECT_THAT(coupled.said,
                  ElementsAre(AllOf(StartsWith("warning: closure: "), HasSubstr("rollback_to its mark"))));
    } else {
      EXPECT_EQ(support::fault_of([&] { coupled.step(); }).code, Code::kNotClosed);
      coupled.session.rollback_to("here");
      coupled.host = marked;
      for (int step = 0; step < 3; ++step) coupled.step();
      EXPECT_THAT(coupled.said, IsEmpty());
    }
    coupled.session.close();
  }
}

}  // namespace
}  // namespace shearbus
