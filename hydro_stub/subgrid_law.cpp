#include "hydro_stub/subgrid_law.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <ctime>
#include <sstream>
#include <thread>

#include "client/src/program_door.hpp"
#include "hydro_stub/restart.hpp"
#include "proto/program/interrupt.hpp"
#include "proto/program/program.hpp"
#include "server/explain.hpp"

namespace shearbus::hydro {
namespace {

struct Calls {
  bool opened = false;  // whether the session is open; until then make_law() tells the doubts about the scene
  bool told = false;    // whether the user of an interrupted run knows what it waits for
};

// Whether the host ends a call that waits for the server. The first interrupt does not: the run needs the answer, and one
// more to save the states of the layers, before it can write a restart dump.
bool ends_call(Calls& calls) {
  if (program::interrupted() && !std::exchange(calls.told, true))
    program::complain("shearbus-hydro: interrupted; waits for the server; another interrupt ends the run at once");
  return program::interrupted_again();
}

Options session_options(const SubgridServer& server, const std::shared_ptr<Calls>& calls) {
  Options options = options_of("shearbus-hydro", server.address);
  options.check_closure = server.check_closure ? SHEARBUS_CHECK_WARN : SHEARBUS_CHECK_OFF;
  options.interrupted = [calls] { return ends_call(*calls); };
  options.log = [calls](const std::string& line) {
    if (calls->opened || !is_about_opening(line)) fmt::print(stderr, "shearbus: {}\n", line);
  };
  if (server.address.endpoint.empty()) {
    options.state_dir = server.state_dir.string();
    options.threads = std::max(1U, std::thread::hardware_concurrency());
  }
  return options;
}

// Adds the time from the construction to the destruction of this object to LawTime::waited, and the CPU time that the
// host's thread used in between to LawTime::cpu.
class Stopwatch {
 public:
  explicit Stopwatch(LawTime& time) : time_(time) {}
  Stopwatch(const Stopwatch&) = delete;
  Stopwatch& operator=(const Stopwatch&) = delete;
  ~Stopwatch() {
    time_.waited += std::chrono::steady_clock::now() - start_;
    time_.cpu += thread_cpu() - cpu_;
  }

 private:
  static std::chrono::nanoseconds thread_cpu() {
    timespec now{};
    ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return std::chrono::seconds(now.tv_sec) + std::chrono::nanoseconds(now.tv_nsec);
  }
  LawTime& time_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  std::chrono::nanoseconds cpu_ = thread_cpu();
};

// The saved state of the law. As text it is one line, MARK SESSION TOKEN: the name of the saved state (mark) in the
// server, then the two halves of the session's ticket.
struct Kept {
  std::string mark;
  std::string ticket;
};

Kept parse_kept(const std::string& text) {
  constexpr std::size_t kDigits = 32;
  std::istringstream words(text);
  std::string mark, session, token;
  words >> mark >> session >> token;
  const bool is_hex = (session + token).find_first_not_of("0123456789abcdef") == std::string::npos;
  if (session.size() != kDigits || token.size() != kDigits || !is_hex)
    throw wire::Error({.code = wire::Code::kInvalidValue,
                       .text = "a restart dump names no session of a subgrid server",
                       .remedy = "It is a dump of another interface law."});
  return {.mark = mark, .ticket = session + ":" + token};
}

bool contains(const std::vector<std::uint32_t>& columns, std::uint32_t column) {
  return std::ranges::find(columns, column) != columns.end();
}

}  // namespace

struct SubgridLaw::Impl {
  // Calls what asks the service in the middle of the run. What the server refuses ends the run, so that the remedy is
  // another than for a host that asks again.
  template <typename Ask>
  auto asking_in_run(const Ask& ask) {
    try {
      return asking(ask);
    } catch (const wire::Error& fault) {
      if (asked == nullptr) throw;
      wire::Status status = fault.status();
      const std::string where = fmt::format("in step {}, to {:.6g} s", asked->step, asked->time);
      const char* const next = kept ? "shearbus-hydro --restart goes on from the newest dump" : "start the run again";
      status.text = where + ": " + status.text;
      if (status.code == wire::Code::kNoSpace) {
        status.remedy = fmt::format("This run has ended. Make room in the server's state directory; then {}.", next);
      } else if (status.code == wire::Code::kUnreachable || status.code == wire::Code::kUnknownOutcome) {
        const std::string stopped = fmt::format("interrupted {}, while the server did not answer; {}", where, next);
        if (program::interrupted_again() && kept) throw Interrupted(stopped);
        if (program::interrupted_again()) throw std::runtime_error(stopped);
        status.remedy = fmt::format("This run has ended. Have the server run again; then {}.", next);
      } else if (status.code == wire::Code::kInvalidValue) {
        status.remedy =
            "This run has ended. The load on the interface is beyond the range of the model: give the scene lower "
            "speeds or pressures, or zones that are not crushed there.";
      }
      throw wire::Error(status);
    }
  }

  Impl(const SubgridServer& where, std::shared_ptr<Calls> calls_of_session, Session opened)
      : calls(std::move(calls_of_session)),
        session(std::move(opened)),
        node_ids(session.node_ids()),
        takes_plastic_strain_rate(
            contains(session.columns(SHEARBUS_OPTIONAL_INPUT), SHEARBUS_SOFT_PLASTIC_STRAIN_RATE)),
        outcome(node_ids.size()),
        outlives_process(!where.address.endpoint.empty() || !where.state_dir.empty()) {
    const std::vector<std::uint32_t> on_request = session.columns(SHEARBUS_OUTPUT_ON_REQUEST);
    for (const wire::Field term : wire::kLedgerColumns)
      if (contains(on_request, static_cast<std::uint32_t>(term))) ledger.emplace_back(term, node_ids.size());
    warnings = lines_of(session.warnings());
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  ~Impl() {
    if (!kept && !closed) close_soon(session);
  }

  void commit() {
    if (std::exchange(trial_stands, false)) session.commit();
  }

  std::shared_ptr<Calls> calls;
  Session session;
  Ids node_ids;
  bool takes_plastic_strain_rate;
  std::vector<std::pair<wire::Field, std::vector<double>>> ledger;  // the columns of the answer's energy ledger
  std::vector<std::uint8_t> outcome;
  std::vector<std::string> warnings;
  bool outlives_process;
  LawTime time;
  const InterfaceInputs* asked = nullptr;  // inputs of the step that was last sent
  InterfaceAnswer* answer = nullptr;
  bool trial_stands = false;
  bool kept = false;
  bool closed = false;
  shearbus_totals totals = SHEARBUS_TOTALS_INIT;  // what the server reported when close() ended the session
};

std::string explain(const SceneText& scene, std::size_t nodes) {
  return server::explain(scene.text, scene.file).text(nodes);
}

SubgridLaw::SubgridLaw(const SceneText& scene, std::span<const std::uint64_t> node_ids,
                       std::span<const double> initial_temperature, const SubgridServer& server,
                       std::span<const double> layer_thickness) {
  const auto calls = std::make_shared<Calls>();
  Options options = session_options(server, calls);
  options.scene_text = scene.text;
  options.scene_name = scene.file;
  Nodes nodes{.ids = {node_ids.begin(), node_ids.end()},
              .initial_temperature_k = {initial_temperature.begin(), initial_temperature.end()},
              .pair = {},
              .parameters = {}};
  if (!layer_thickness.empty())
    nodes.parameters = {{"layer.thickness_m", {layer_thickness.begin(), layer_thickness.end()}}};
  impl_ = asking([&] { return std::make_unique<Impl>(server, calls, Session::open_nodes(options, nodes)); });
  calls->opened = true;
}

// Restores the layers from a mark (a named copy of their states in the server), then sets the same mark again. The
// server keeps only the newest two marks: set again, this one is the newest, and the next mark does not replace it.
SubgridLaw::SubgridLaw(const std::string& kept, const SubgridServer& server) {
  const Kept point = parse_kept(kept);
  const auto calls = std::make_shared<Calls>();
  asking([&] {
    impl_ = std::make_unique<Impl>(server, calls, Session::resume(session_options(server, calls), point.ticket));
    calls->opened = true;
    impl_->kept = true;
    impl_->session.rollback_to(point.mark);
    impl_->session.mark(point.mark);
  });
}
SubgridLaw::~SubgridLaw() = default;

void SubgridLaw::advance(const InterfaceInputs& in, InterfaceAnswer& answer) {
  start(in, answer);
  finish();
}

void SubgridLaw::start(const InterfaceInputs& in, InterfaceAnswer& answer) {
  const Stopwatch stopwatch(impl_->time);
  Step step(impl_->node_ids.size());
  step.dt(in.dt).time(in.time).number(in.step).commit_previous(impl_->trial_stands);
  step.in(SHEARBUS_VELOCITY_JUMP, in.velocity_jump).in(SHEARBUS_PRESSURE, in.pressure);
  step.in(SHEARBUS_STRESS_SOFT, in.stress_soft).in(SHEARBUS_STRESS_HARD, in.stress_hard);
  step.in(SHEARBUS_MASS_SOFT, in.mass_soft).in(SHEARBUS_MASS_HARD, in.mass_hard);
  if (impl_->takes_plastic_strain_rate && !in.soft_plastic_strain_rate.empty())
    step.in(SHEARBUS_SOFT_PLASTIC_STRAIN_RATE, in.soft_plastic_strain_rate);
  step.out(SHEARBUS_SHEAR_STRESS, answer.shear_stress).out(SHEARBUS_VELOCITY_JUMP_NEW, answer.velocity_jump_new);
  step.out(SHEARBUS_SLIDING_VELOCITY, answer.sliding_velocity);
  step.out(SHEARBUS_INTERFACE_TEMPERATURE, answer.interface_temperature);
  step.out(SHEARBUS_FRICTION_HEAT, answer.friction_heat);
  step.out(SHEARBUS_REGIME, answer.regime).out(SHEARBUS_OUTCOME, impl_->outcome);
  for (auto& [term, values] : impl_->ledger) step.out(static_cast<std::uint32_t>(term), values);
  impl_->asked = &in;
  impl_->asking_in_run([&] { impl_->session.start(step, SHEARBUS_TRIAL); });
  impl_->answer = &answer;
}

void SubgridLaw::finish() {
  const Stopwatch stopwatch(impl_->time);
  const shearbus_result result = impl_->asking_in_run([&] { return impl_->session.finish(); });
  impl_->trial_stands = true;
  const std::chrono::nanoseconds solver(result.solver_ns);
  impl_->time.solver += solver;
  impl_->time.service += std::chrono::nanoseconds(result.service_ns);
  impl_->time.bus += std::chrono::nanoseconds(result.round_trip_ns) - solver;

  const auto failed =
      std::ranges::find_if(impl_->outcome, [](std::uint8_t bits) { return (bits & SHEARBUS_OUTCOME_FAILED) != 0; });
  if (failed != impl_->outcome.end()) {
    const auto row = static_cast<std::size_t>(failed - impl_->outcome.begin());
    const std::uint64_t node = impl_->node_ids[row];
    const InterfaceInputs& in = *impl_->asked;
    throw wire::Error(
        {.code = wire::Code::kUnexpectedReply,
         .text = fmt::format("the server found no answer for node {} in step {} ([V] {} m/s, P {} Pa, dt {} s)", node,
                             in.step, in.velocity_jump[row], in.pressure[row], in.dt),
         .remedy = "the run stops here; a smaller dt may help",
         .node_ids = {node}});
  }
  InterfaceAnswer& answer = *impl_->answer;
  answer.energy = {};
  for (const auto& [term, values] : impl_->ledger) answer.energy.add(term, values);
  answer.flagged = result.flagged_nodes;
}

LawTime SubgridLaw::time_spent() const {
  return impl_->time;
}
const std::vector<std::string>& SubgridLaw::warnings() const {
  return impl_->warnings;
}
void SubgridLaw::take_back() {
  impl_->asking_in_run([&] { impl_->session.rollback(); });
  impl_->trial_stands = false;
}
wire::Batch SubgridLaw::profiles(std::span<const std::uint64_t> node_ids, std::span<const double> pressure_pa) {
  const Stopwatch stopwatch(impl_->time);
  const Profiles found = impl_->asking_in_run([&] {
    impl_->commit();
    return impl_->session.profiles({node_ids.begin(), node_ids.end()}, {pressure_pa.begin(), pressure_pa.end()});
  });
  return rows_of(found, impl_->session.info().tangential_components);
}
std::string SubgridLaw::keep(const std::string& name) {
  return impl_->asking_in_run([&] {
    impl_->commit();
    impl_->session.mark(name);
    impl_->kept = true;
    std::string ticket = impl_->session.ticket();
    ticket[ticket.find(':')] = ' ';
    return name + " " + ticket;
  });
}

std::string SubgridLaw::cannot_keep() const {
  if (impl_->outlives_process) return {};
  return "the layers live in this process and end with it: ask for dumps at the start (--dump-every or "
         "--dump-interval), or run the server as a process of its own (--server)";
}

void SubgridLaw::close() {
  impl_->asking_in_run([&] {
    impl_->commit();
    impl_->totals = impl_->session.end();
  });
  impl_->kept = false;
  impl_->closed = true;
}

OmittedCost SubgridLaw::omitted_cost() const {
  const shearbus_totals& totals = impl_->totals;
  const server::OmittedCost omitted =
      server::omitted_cost(impl_->session.effective_scene(),
                           {.node_steps = totals.node_steps, .asleep_node_steps = totals.asleep_node_steps});
  return {.lines = omitted.lines(),
          .parts = omitted.parts,
          .bytes_per_node = omitted.bytes_per_node,
          .bytes_per_node_with_everything = omitted.bytes_per_node_with_everything,
          .share_asleep = omitted.share_asleep};
}

}  // namespace shearbus::hydro
