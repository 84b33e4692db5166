#include "hydro_stub/subgrid_law.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <chrono>
#include <ctime>
#include <functional>
#include <optional>
#include <sstream>

#include "client/src/client.hpp"
#include "server/embedded.hpp"
#include "server/explain.hpp"

namespace shearbus::hydro {
namespace {

ClientOptions client_options(const SubgridServer& server, const std::optional<server::Embedded>& embedded) {
  const files::ServerAddress& address = server.address;
  ClientOptions options;
  options.check_closure = server.check_closure ? CheckClosure::kWarn : CheckClosure::kOff;
  options.name = "shearbus-hydro";
  options.endpoint = embedded ? embedded->endpoint() : address.endpoint;
  options.server_key = address.server_key;
  options.secret_key = address.secret_key;
  options.context = embedded ? embedded->context() : nullptr;
  return options;
}

std::optional<server::Embedded> embed(const SubgridServer& server) {
  if (!server.address.endpoint.empty()) return std::nullopt;
  server::ServerOptions options;
  options.state_dir = server.state_dir.string();
  return std::optional<server::Embedded>(std::in_place, options);
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

template <std::size_t kSize>
std::string hex(const std::array<std::uint8_t, kSize>& bytes) {
  return fmt::format("{:02x}", fmt::join(bytes, ""));
}

// The saved state of the law. As text it is one line, MARK SESSION TOKEN: the name of the saved state (mark) in the
// server, then the session id and the resume token, both in hexadecimal.
struct Kept {
  std::string mark;
  Session::Ticket ticket;
};

Kept parse_kept(const std::string& text) {
  std::istringstream words(text);
  std::string mark, session, token;
  words >> mark >> session >> token;
  Kept kept{.mark = mark, .ticket = {}};
  const auto read = [](const std::string& digits, std::span<std::uint8_t> bytes) {
    if (digits.size() != 2 * bytes.size()) return false;
    for (std::size_t i = 0; i < bytes.size(); ++i) {
      const char* first = digits.data() + 2 * i;
      if (std::from_chars(first, first + 2, bytes[i], 16).ptr != first + 2) return false;
    }
    return true;
  };
  if (!read(session, kept.ticket.session_id) || !read(token, kept.ticket.resume_token))
    throw Error({.code = Code::kInvalidValue,
                 .text = "a restart dump names no session of a subgrid server",
                 .remedy = "It is a dump of another interface law."});
  return kept;
}

void copy(std::span<const double> from, std::span<double> to) {
  std::ranges::copy(from, to.begin());
}

}  // namespace

// The order of the members matters: the session is destroyed before its client, the client before its server.
struct SubgridLaw::Impl {
  Impl(const SubgridServer& where, const std::function<Session(Client&)>& enter)
      : embedded(embed(where)),
        client(client_options(where, embedded)),
        session(enter(client)),
        wants_soft_plastic_strain_rate(
            std::ranges::find(session.opened().optional_columns, Field::kSoftPlasticStrainRate) !=
            session.opened().optional_columns.end()),
        request(session.request()),
        server(embedded ? "in this process" : where.address.endpoint),
        outlives_process(!embedded || !where.state_dir.empty()) {
    session.want_energy_ledger();
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  ~Impl() {
    if (kept) session.leave();
  }

  std::optional<server::Embedded> embedded;
  Client client;
  Session session;
  // true: the session accepts this optional column, but `request` does not yet have it
  bool wants_soft_plastic_strain_rate;
  Batch request;  // columns that are sent in each step
  std::string server;
  bool outlives_process;
  LawTime time;
  const InterfaceInputs* asked = nullptr;  // inputs of the step that was last sent
  InterfaceAnswer* answer = nullptr;
  bool trial_stands = false;
  bool kept = false;
  wire::SessionClosed totals;  // what the server reported when close() ended the session
};

std::string explain(const SceneText& scene, std::size_t nodes) {
  return server::explain(scene.text, scene.file).text(nodes);
}

SubgridLaw::SubgridLaw(const SceneText& scene, std::span<const std::uint64_t> node_ids,
                       std::span<const double> initial_temperature, const SubgridServer& server,
                       std::span<const double> layer_thickness)
    : impl_(std::make_unique<Impl>(server, [&](Client& client) {
        OpenOptions options{.initial_temperature_k = initial_temperature};
        if (!layer_thickness.empty()) options.parameters = {{.key = "layer.thickness_m", .values = layer_thickness}};
        return client.open(scene.text, scene.file, node_ids, options);
      })) {}

// Restores the layers from a mark (a named copy of their states in the server), then sets the same mark again. The
// server keeps only the newest two marks: set again, this one is the newest, and the next mark does not replace it.
SubgridLaw::SubgridLaw(const std::string& kept, const SubgridServer& server) {
  const Kept point = parse_kept(kept);
  impl_ = std::make_unique<Impl>(server, [&](Client& client) { return client.resume(point.ticket); });
  impl_->kept = true;
  impl_->session.rollback_to(point.mark);
  impl_->session.mark(point.mark);
}
SubgridLaw::~SubgridLaw() = default;

void SubgridLaw::advance(const InterfaceInputs& in, InterfaceAnswer& answer) {
  start(in, answer);
  finish();
}

void SubgridLaw::start(const InterfaceInputs& in, InterfaceAnswer& answer) {
  const Stopwatch stopwatch(impl_->time);
  if (impl_->wants_soft_plastic_strain_rate && !in.soft_plastic_strain_rate.empty()) {
    impl_->request = impl_->session.request(std::array{Field::kSoftPlasticStrainRate});
    impl_->wants_soft_plastic_strain_rate = false;
  }
  Batch& request = impl_->request;
  if (request.has(Field::kSoftPlasticStrainRate))
    copy(in.soft_plastic_strain_rate, request.f64(Field::kSoftPlasticStrainRate));
  copy(in.velocity_jump, request.f64(Field::kVelocityJump));
  copy(in.pressure, request.f64(Field::kPressure));
  copy(in.stress_soft, request.f64(Field::kStressSoft));
  copy(in.stress_hard, request.f64(Field::kStressHard));
  copy(in.mass_soft, request.f64(Field::kMassSoft));
  copy(in.mass_hard, request.f64(Field::kMassHard));
  impl_->session.start_trial(
      request, {.dt_s = in.dt, .time_s = in.time, .step = in.step, .commit_previous = impl_->trial_stands});
  impl_->asked = &in;
  impl_->answer = &answer;
}

void SubgridLaw::finish() {
  const Stopwatch stopwatch(impl_->time);
  const StepResult& result = impl_->session.finish_trial();
  InterfaceAnswer& answer = *impl_->answer;
  impl_->trial_stands = true;
  const std::chrono::nanoseconds solver(result.upscale().solver_ns);
  impl_->time.solver += solver;
  impl_->time.service += std::chrono::nanoseconds(result.upscale().service_ns);
  impl_->time.bus += result.round_trip() - solver;

  const std::span<const std::uint8_t> outcome = result.outcome();
  const auto failed = std::ranges::find_if(outcome, [](std::uint8_t bits) { return (bits & wire::kFailed) != 0; });
  if (failed != outcome.end()) {
    const auto row = static_cast<std::size_t>(failed - outcome.begin());
    const std::uint64_t node = impl_->session.node_ids()[row];
    const InterfaceInputs& in = *impl_->asked;
    throw Error({.code = Code::kUnexpectedReply,
                 .text = fmt::format("the server found no answer for node {} in step {} ([V] {} m/s, P {} Pa, dt {} s)",
                                     node, in.step, in.velocity_jump[row], in.pressure[row], in.dt),
                 .remedy = "the run stops here; a smaller dt may help",
                 .node_ids = {node}});
  }
  copy(result.shear_stress_pa(), answer.shear_stress);
  copy(result.velocity_jump_new_m_per_s(), answer.velocity_jump_new);
  copy(result.sliding_velocity_m_per_s(), answer.sliding_velocity);
  copy(result.interface_temperature_k(), answer.interface_temperature);
  copy(result.friction_heat_j_per_m2(), answer.friction_heat);
  std::ranges::copy(result.regime(), answer.regime.begin());
  answer.energy = {};
  answer.energy.add(result.batch());
  answer.flagged = result.upscale().flagged_nodes;
}

LawTime SubgridLaw::time_spent() const {
  return impl_->time;
}
const std::string& SubgridLaw::server() const {
  return impl_->server;
}
const std::vector<std::string>& SubgridLaw::warnings() const {
  return impl_->session.warnings();
}
void SubgridLaw::take_back() {
  impl_->session.rollback();
  impl_->trial_stands = false;
}
wire::Batch SubgridLaw::profiles(std::span<const std::uint64_t> node_ids, std::span<const double> pressure_pa) {
  const Stopwatch stopwatch(impl_->time);
  if (std::exchange(impl_->trial_stands, false)) impl_->session.commit();
  return impl_->session.profiles(node_ids, pressure_pa).rows;
}
std::string SubgridLaw::keep(const std::string& name) {
  if (impl_->trial_stands) impl_->session.commit();
  impl_->trial_stands = false;
  impl_->session.mark(name);
  impl_->kept = true;
  const Session::Ticket ticket = impl_->session.ticket();
  return fmt::format("{} {} {}", name, hex(ticket.session_id), hex(ticket.resume_token));
}

std::string SubgridLaw::cannot_keep() const {
  if (impl_->outlives_process) return {};
  return "the layers live in this process and end with it: ask for dumps at the start (--dump-every or "
         "--dump-interval), or run the server as a process of its own (--server)";
}

void SubgridLaw::close() {
  if (impl_->trial_stands) impl_->session.commit();
  impl_->trial_stands = false;
  impl_->totals = impl_->session.close();
  impl_->kept = false;
}

OmittedCost SubgridLaw::omitted_cost() const {
  const server::OmittedCost omitted = server::omitted_cost(impl_->session.effective_scene(), impl_->totals);
  return {.lines = omitted.lines(),
          .parts = omitted.parts,
          .bytes_per_node = omitted.bytes_per_node,
          .bytes_per_node_with_everything = omitted.bytes_per_node_with_everything,
          .share_asleep = omitted.share_asleep};
}

}  // namespace shearbus::hydro
