#include "hydro_stub/subgrid_law.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

#include "server/embedded.hpp"
#include "shearbus/client.hpp"

namespace shearbus::hydro {
namespace {

ClientOptions client_options(const wire::ServerAddress& server, const std::optional<server::Embedded>& embedded) {
  ClientOptions options;
  options.name = "shearbus-hydro";
  options.endpoint = embedded ? embedded->endpoint() : server.endpoint;
  options.server_key = server.server_key;
  options.secret_key = server.secret_key;
  options.context = embedded ? embedded->context() : nullptr;
  return options;
}

std::optional<server::Embedded> embed(bool wanted) {
  if (!wanted) return std::nullopt;
  return std::optional<server::Embedded>(std::in_place);
}

void copy(std::span<const double> from, std::span<double> to) {
  std::ranges::copy(from, to.begin());
}

}  // namespace

// Members are made top-down and end bottom-up: the session says goodbye before its client goes, the client before its
// server.
struct SubgridLaw::Impl {
  Impl(const wire::Scene& scene, std::span<const std::uint64_t> node_ids, std::span<const double> initial_temperature,
       const wire::ServerAddress& address)
      : embedded(embed(address.endpoint.empty())),
        client(client_options(address, embedded)),
        session(client.open(scene, node_ids, {.initial_temperature_k = initial_temperature})),
        request(session.request()),
        server(embedded ? "in this process" : address.endpoint) {}

  std::optional<server::Embedded> embedded;
  Client client;
  Session session;
  Batch request;  // filled anew each step
  std::string server;
  LawTime time;
  bool trial_stands = false;
};

SubgridLaw::SubgridLaw(const wire::Scene& scene, std::span<const std::uint64_t> node_ids,
                       std::span<const double> initial_temperature, const wire::ServerAddress& server)
    : impl_(std::make_unique<Impl>(scene, node_ids, initial_temperature, server)) {}
SubgridLaw::~SubgridLaw() = default;

void SubgridLaw::advance(const InterfaceInputs& in, InterfaceAnswer& answer) {
  Batch& request = impl_->request;
  copy(in.velocity_jump, request.f64(Field::kVelocityJump));
  copy(in.pressure, request.f64(Field::kPressure));
  copy(in.stress_minus, request.f64(Field::kStressMinus));
  copy(in.stress_plus, request.f64(Field::kStressPlus));
  copy(in.mass_minus, request.f64(Field::kMassMinus));
  copy(in.mass_plus, request.f64(Field::kMassPlus));

  const StepResult& result = impl_->session.trial(
      request, {.dt_s = in.dt, .time_s = in.time, .step = in.step, .commit_previous = impl_->trial_stands});
  impl_->trial_stands = true;
  const std::chrono::nanoseconds solver(result.upscale().solver_ns);
  impl_->time.solver += solver;
  impl_->time.bus += result.round_trip() - solver;

  const std::span<const std::uint8_t> outcome = result.outcome();
  const auto failed = std::ranges::find_if(outcome, [](std::uint8_t bits) { return (bits & wire::kFailed) != 0; });
  if (failed != outcome.end()) {
    const auto row = static_cast<std::size_t>(failed - outcome.begin());
    const std::uint64_t node = impl_->session.node_ids()[row];
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
void SubgridLaw::close() {
  if (impl_->trial_stands) impl_->session.commit();
  impl_->trial_stands = false;
  impl_->session.close();
}

}  // namespace shearbus::hydro
