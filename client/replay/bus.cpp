#include "client/replay/bus.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <thread>

#include "client/src/program_door.hpp"
#include "proto/program/interrupt.hpp"

namespace shearbus::replay {
namespace {

shearbus::Options options_of(const files::ServerAddress& server, const std::string& scene,
                             const std::string& scene_file) {
  shearbus::Options options = shearbus::options_of("shearbus-replay", server);
  options.scene_text = scene;
  options.scene_name = scene_file;
  options.check_closure = SHEARBUS_CHECK_OFF;  // unlike a host, a history does not react to answers
  options.threads = std::max(1U, std::thread::hardware_concurrency());
  options.interrupted = [] { return program::interrupted(); };
  options.log = [](const std::string& line) {
    if (!is_about_opening(line)) fmt::print(stderr, "shearbus-replay: {}\n", line);
  };
  return options;
}

wire::SessionOpened facts_of(const shearbus::Session& session) {
  const shearbus_info info = session.info();
  const auto columns = [&](int use) {
    std::vector<Field> fields;
    for (const std::uint32_t column : session.columns(use)) fields.push_back(static_cast<Field>(column));
    return fields;
  };
  return {.effective_scene = session.effective_scene(),
          .bytes_per_node = info.bytes_per_node,
          .warnings = lines_of(session.warnings()),
          .strategy = static_cast<wire::Strategy>(info.strategy),
          .tangential_components = info.tangential_components,
          .required_columns = columns(SHEARBUS_REQUIRED_INPUT),
          .optional_columns = columns(SHEARBUS_OPTIONAL_INPUT),
          .reply_columns = columns(SHEARBUS_DEFAULT_OUTPUT),
          .columns_on_request = columns(SHEARBUS_OUTPUT_ON_REQUEST),
          .scene_name = session.text(SHEARBUS_SCENE_NAME),
          .pairs = lines_of(session.text(SHEARBUS_PAIR_NAMES)),
          .parameters = lines_of(session.text(SHEARBUS_PARAMETER_KEYS))};
}

}  // namespace

struct Bus::Impl {
  Impl(const shearbus::Options& options, const shearbus::Nodes& nodes)
      : session(shearbus::Session::open_nodes(options, nodes)),
        rows(nodes.ids.size()),
        opened(facts_of(session)),
        server_version(session.text(SHEARBUS_SERVER_VERSION)),
        wanted(opened.reply_columns) {}

  shearbus::Session session;
  std::size_t rows;
  wire::SessionOpened opened;
  std::string server_version;
  std::vector<Field> wanted;
  Answer answer;
  bool closed = false;
};

Bus::Bus(const files::ServerAddress& server, const std::string& scene, const std::string& scene_file,
         std::span<const std::uint64_t> node_ids, const NodeProperties& properties)
    : impl_(asking([&] {
        return std::make_unique<Impl>(options_of(server, scene, scene_file),
                                      shearbus::Nodes{.ids = {node_ids.begin(), node_ids.end()},
                                                      .initial_temperature_k = properties.initial_temperature_k,
                                                      .pair = properties.pair,
                                                      .parameters = properties.parameters});
      })) {}

Bus::~Bus() {
  if (!impl_->closed) close_soon(impl_->session);
}

const wire::SessionOpened& Bus::opened() const {
  return impl_->opened;
}
const std::string& Bus::server_version() const {
  return impl_->server_version;
}

Batch Bus::request(std::span<const Field> optional_columns, Form form) const {
  std::vector<Field> fields = wire::columns_in(form, impl_->opened.required_columns);
  fields.insert(fields.end(), optional_columns.begin(), optional_columns.end());
  return Batch::of(fields, impl_->rows, impl_->opened.tangential_components);
}

void Bus::want_energy_ledger() {
  for (const Field term : wire::kLedgerColumns)
    if (std::ranges::find(impl_->opened.columns_on_request, term) != impl_->opened.columns_on_request.end())
      impl_->wanted.push_back(term);
}

const Answer& Bus::advance(const Batch& request, double dt_s, double time_s, std::uint64_t step) {
  Batch& answer = impl_->answer.columns;
  answer.reshape(impl_->wanted, impl_->rows, impl_->opened.tangential_components);
  shearbus::Step asked(impl_->rows);
  asked.dt(dt_s).time(time_s).number(step);
  for (const wire::Column& column : request.columns()) {
    const auto values = request.f64(column.field, column.component);
    asked.in(static_cast<std::uint32_t>(column.field), values, column.component);
  }
  for (const wire::Column& column : answer.columns()) {
    const auto out = [&](auto values) {
      asked.out(static_cast<std::uint32_t>(column.field), values, column.component);
    };
    if (column.element == wire::Element::kUint8)
      out(answer.u8(column.field, column.component));
    else
      out(answer.f64(column.field, column.component));
  }
  impl_->answer.result = asking([&] { return impl_->session.step(asked); });
  return impl_->answer;
}

Batch Bus::profiles(std::span<const std::uint64_t> node_ids, const std::vector<double>& pressure_pa) {
  const auto found = asking([&] { return impl_->session.profiles({node_ids.begin(), node_ids.end()}, pressure_pa); });
  return rows_of(found, impl_->opened.tangential_components);
}

wire::SessionClosed Bus::close() {
  const shearbus_totals totals = asking([&] { return impl_->session.end(); });
  impl_->closed = true;
  return {.requests = totals.requests,
          .node_steps = totals.node_steps,
          .solver_ns = totals.solver_ns,
          .asleep_node_steps = totals.asleep_node_steps};
}

}  // namespace shearbus::replay
