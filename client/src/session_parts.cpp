// Steps of more rows than a message holds, which are sent in parts.
#include <algorithm>
#include <array>
#include <new>
#include <utility>

#include "client/src/session.hpp"
#include "proto/wire/codec.hpp"
#include "proto/wire/xxh3.hpp"

namespace shearbus {

void add_warnings(std::vector<std::string>& all, std::span<const std::string> some) {
  for (const std::string& warning : some)
    if (std::ranges::find(all, warning) == all.end()) all.push_back(warning);
}

void add_rows(wire::Upscale& sum, const wire::Upscale& some) {
  if (some.nodes != 0 && (sum.nodes == 0 || some.largest_closure_m_per_s > sum.largest_closure_m_per_s)) {
    sum.largest_closure_m_per_s = some.largest_closure_m_per_s;
    sum.closure_node = some.closure_node;
    sum.layer_time_s = some.layer_time_s;
  }
  sum.nodes += some.nodes;
  sum.flagged_nodes += some.flagged_nodes;
  add_warnings(sum.warnings, some.warnings);
}

// Columns of unequal length are sent undivided: the server refuses them with a reason.
bool SessionState::needs_parts(const Batch& columns) const {
  const auto& all = columns.columns();
  return !all.empty() && all.front().count > connection->max_rows() &&
         std::ranges::all_of(all, [&](const wire::Column& column) { return column.count == all.front().count; });
}

Batch SessionState::part_rows(const Batch& columns, std::uint32_t part) const {
  const std::size_t rows = columns.columns().front().count;
  const std::size_t first = (part - 1) * connection->max_rows();
  const std::size_t count = std::min(connection->max_rows(), rows - first);
  std::vector<Field> fields = {Field::kNodeId};
  for (const wire::Column& column : columns.columns())
    if (column.field != Field::kNodeId && column.component == 0) fields.push_back(column.field);
  Batch batch = Batch::of(fields, count, opened.tangential_components);
  const std::span<const std::uint64_t> ids = columns.has(Field::kNodeId) ? columns.u64(Field::kNodeId) : node_ids;
  std::ranges::copy(ids.subspan(first, count), batch.u64(Field::kNodeId).begin());
  for (const wire::Column& column : columns.columns())
    if (column.field != Field::kNodeId)
      std::ranges::copy(columns.f64(column.field, column.component).subspan(first, count),
                        batch.f64(column.field, column.component).begin());
  return batch;
}

std::uint32_t SessionState::parts_of(std::size_t rows) const {
  return static_cast<std::uint32_t>((rows + connection->max_rows() - 1) / connection->max_rows());
}

wire::Request SessionState::part_request(Batch rows, const wire::Downscale& step, std::uint32_t part,
                                         std::uint32_t parts) const {
  wire::Request request = next_request();
  wire::Downscale& body = request.body.emplace<wire::Downscale>(step);
  body.part = part;
  body.parts = parts;
  body.commit_previous = step.commit_previous && part == 1 && !previous_committed;
  request.batch = std::move(rows);
  return request;
}

// The part behind `before`, to be sent before that one is answered.
wire::Request SessionState::part_behind(const wire::Request& before, Batch rows) {
  const auto& step = std::get<wire::Downscale>(before.body);
  wire::Request request = part_request(std::move(rows), step, step.part + 1, step.parts);
  StepInParts::Sent& sent = in_parts->behind;
  // A part of another epoch cannot have run, because the part before it has not.
  if (sent.request_id == 0 || sent.epoch != before.epoch) {
    sent = {.request_id = connection->next_request_id(),
            .epoch = before.epoch,
            .follows = hash_of(before, connection->payload_sum())};
  }
  request.sequence = before.sequence + 1;
  request.request_id = sent.request_id;
  request.epoch = sent.epoch;
  std::get<wire::Downscale>(request.body).follows = sent.follows;
  return request;
}

// Copies the answers of a part to their rows of the whole reply.
void SessionState::copy_part(const Received& part, std::size_t first_row) noexcept {
  Batch& whole = in_parts->whole.reply.batch;
  const Batch& rows = part.reply.batch;
  each_column(rows, whole,
              [&](const wire::Column&, auto from, auto to) { std::ranges::copy(from, to.subspan(first_row).begin()); });
}

// Adds what the answer of a part says of all its rows.
void SessionState::add_part(const Received& part) {
  const auto& answer = std::get<wire::Upscale>(part.reply.body);
  auto& sum = std::get<wire::Upscale>(in_parts->whole.reply.body);
  add_rows(sum, answer);
  sum.state_version = answer.state_version;
  sum.solver_ns += answer.solver_ns;
  sum.service_ns += answer.service_ns;
  in_parts->whole.reply.replayed |= part.reply.replayed;
  in_parts->whole.round_trip += part.round_trip;
  ++in_parts->answered;
}

// A step of more rows than a message holds. While the server computes a part, the rows of the next part are gathered
// and sent, if the server takes parts ahead, and the answers of the part before it are copied. If a part has no answer
// in time, a repetition of the call goes on with that part, and sends what was sent before with the same bytes. If a
// part is refused, the parts before it are dropped; the part behind it was refused, too, because it follows that part.
// `first`: part 1, if it was posted.
const StepResult& SessionState::step_in_parts(const Batch& columns, const StepOptions& options,
                                              std::optional<wire::Request> first) {
  const auto step = std::get<wire::Downscale>(first ? first->body : step_request(columns, options).body);
  const std::size_t rows = columns.columns().front().count;
  wire::Downscale whole = step;
  whole.part = whole.parts = 0;
  whole.commit_previous = options.commit_previous;
  const std::string header = wire::encode_header(wire::Request{.body = whole});
  const std::array<std::span<const std::byte>, 2> bytes = {std::as_bytes(std::span(header)), columns.bytes()};
  const std::uint64_t hash = wire::hash_of(bytes);
  if (!in_parts || in_parts->hash != hash) {
    in_parts = StepInParts{};
    in_parts->hash = hash;
    in_parts->whole.reply.body = wire::Upscale{};
  }
  const std::uint32_t parts = parts_of(rows);
  std::optional<Received> to_copy;  // the last part that was answered
  const auto copy = [&]() noexcept {
    if (to_copy) copy_part(*to_copy, (in_parts->answered - 1) * connection->max_rows());
    to_copy.reset();
  };
  Batch next;                           // rows of the next part; without columns if they are not gathered yet
  std::optional<wire::Request> behind;  // the next part, if it was sent ahead
  auto answered_at = Connection::Clock::time_point();  // of the last part
  try {
    while (in_parts->answered < parts) {
      const std::uint32_t part = in_parts->answered + 1;
      wire::Request request;
      if (first) {
        request = *std::exchange(first, std::nullopt);
      } else if (behind) {
        request = *std::exchange(behind, std::nullopt);
      } else {
        request = part_request(next.columns().empty() ? part_rows(columns, part) : std::exchange(next, {}), whole, part,
                               parts);
        if (const auto& sent = in_parts->next; sent.request_id != 0) {
          if (!in_doubt) {
            request.request_id = sent.request_id;
            request.epoch = sent.epoch;
          }
          std::get<wire::Downscale>(request.body).follows = sent.follows;
        }
        post(request);
      }
      in_parts->next = {.request_id = request.request_id,
                        .epoch = request.epoch,
                        .follows = std::get<wire::Downscale>(request.body).follows};
      try {
        next = part < parts ? part_rows(columns, part + 1) : Batch();
        if (part < parts && connection->parts_ahead()) {
          behind = part_behind(request, std::exchange(next, {}));
          connection->post_behind(*behind);
        }
        Batch& answers = in_parts->whole.reply.batch;
        if (answers.columns().empty())
          answers =
              Batch::of(step.wanted.empty() ? opened.reply_columns : step.wanted, rows, opened.tangential_components);
        copy();
      } catch (const std::bad_alloc&) {
        keep_in_doubt(request);
        throw;
      }
      Received received = exchange(request);
      if (behind && request.epoch != behind->epoch) {  // after a restart, which the part behind did not survive
        behind.reset();
        in_parts->behind = {};
      }
      const auto now = connection->now();
      received.round_trip = std::min<std::chrono::nanoseconds>(received.round_trip, now - answered_at);
      answered_at = now;
      add_part(received);
      in_parts->next = std::exchange(in_parts->behind, {});
      to_copy = std::move(received);
    }
    copy();
  } catch (const Error& fault) {
    copy();
    const Code code = fault.status().code;
    const bool goes_on = in_doubt || code == Code::kUnreachable || code == Code::kAuth;
    if (goes_on) throw;  // the same call goes on
    const bool begun = in_parts->answered != 0;
    in_parts.reset();
    if (!begun) throw;
    previous_committed = options.commit_previous;
    try {
      exchange<wire::RolledBack>(wire::Rollback{});
    } catch (const Error&) {
      // The next step drops the parts, too.
    }
    throw;
  }
  previous_committed = false;
  check_answered(columns, in_parts->whole.reply);
  state_version = std::get<wire::Upscale>(in_parts->whole.reply.body).state_version;
  static_cast<Received&>(result) = std::move(in_parts->whole);
  in_parts.reset();
  return result;
}

}  // namespace shearbus
