// Steps and profiles of the C interface: from the caller's columns to a request, and from the answer to them.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>

#include "client/src/c_session.hpp"
#include "client/src/closure_check.hpp"

using namespace shearbus;

namespace {

bool contains(std::span<const Field> fields, Field field) {
  return std::ranges::find(fields, field) != fields.end();
}

std::string column_name(std::uint32_t field, std::uint32_t component) {
  const char* name = shearbus_field_name(field);
  return fmt::format("{}{}", name == nullptr ? fmt::format("column {}", field) : name,
                     component == 0 ? "" : fmt::format(" component {}", component));
}

std::string names_of_columns(std::span<const Field> first, std::span<const Field> second) {
  std::string text;
  for (const std::span<const Field> fields : {first, second})
    for (const Field field : fields) text += fmt::format("{}{}", text.empty() ? "" : ", ", wire::name(field));
  return text.empty() ? "none" : text;
}

// What a host should know that sends the stresses and masses of a force-driven step to a velocity-driven scene, or asks
// for sums that its scene does not keep.
const char* hint_of(const Session& session, Field field) {
  if (field == Field::kFrictionEnergySoft || field == Field::kFrictionEnergyHard)
    return " The scene needs friction_energy = true.";
  constexpr std::array kForceDriven = {Field::kStressSoft, Field::kStressHard,  Field::kMassSoft,
                                       Field::kMassHard,   Field::kStickStress, Field::kImpedance};
  return session.opened.strategy == wire::Strategy::kVelocityDriven && contains(kForceDriven, field)
             ? " The scene has strategy = \"velocity_driven\"; stresses, masses and impedances belong to "
               "\"force_driven\"."
             : "";
}

// Refuses values that overlap, as those of a stride that was meant in elements.
void check_stride(std::uint32_t field, std::uint32_t component, std::ptrdiff_t stride_bytes) {
  constexpr std::ptrdiff_t kLargestElement = sizeof(double);
  if (stride_bytes == 0 || stride_bytes >= kLargestElement || stride_bytes <= -kLargestElement) return;
  const std::ptrdiff_t element =
      wire::element_of(static_cast<Field>(field)) == wire::Element::kUint8 ? 1 : kLargestElement;
  if (stride_bytes >= element || stride_bytes <= -element) return;
  const std::string name = column_name(field, component);
  refuse(Code::kInvalidValue,
         fmt::format("{}: stride_bytes is {}, expected 0 or at least {}, the size of a value, in bytes", name,
                     stride_bytes, element),
         "Give the distance of two values in bytes: that in elements times the size of an element.", name);
}

// Refuses a column that the session does not have, a component that the scene does not have, or values that are NULL.
void check_column(const Session& session, std::uint32_t number, std::uint32_t component, const void* values,
                  std::ptrdiff_t stride_bytes, const char* kind, std::span<const Field> first,
                  std::span<const Field> second) {
  const auto field = static_cast<Field>(number);
  const auto refuse_column = [&](Code code, const std::string& text, std::string remedy) {
    const std::string name = column_name(number, component);
    refuse(code, name + text, std::move(remedy), name);
  };
  if (!contains(first, field) && !contains(second, field))
    refuse_column(Code::kUnsupported, fmt::format(" is no {} of this session", kind),
                  fmt::format("Its {}s are: {}.{}", kind, names_of_columns(first, second), hint_of(session, field)));
  const std::uint32_t components = wire::is_tangential(field) ? session.opened.tangential_components : 1;
  if (component >= components)
    refuse_column(Code::kShape,
                  fmt::format(": the scene gives this column {} component{}", components, components == 1 ? "" : "s"),
                  "Set tangential_components in the scene, or leave the column out.");
  if (values == nullptr) refuse_column(Code::kInvalidValue, ": values is NULL", "Give one value per row.");
  check_stride(number, component, stride_bytes);
}

// The fields of the inputs, each once. Refuses an input field of which a component is missing or given twice.
std::vector<Field> fields_of(const Session& session, std::span<const shearbus_input> inputs, bool with_node_ids) {
  const wire::SessionOpened& opened = session.opened;
  std::vector<Field> others = opened.optional_columns;
  if (opened.strategy == wire::Strategy::kForceDriven)
    others.insert(others.end(), wire::kStickColumns.begin(), wire::kStickColumns.end());
  std::vector<Field> fields;
  if (with_node_ids) fields.push_back(Field::kNodeId);
  for (const shearbus_input& input : inputs) {
    check_column(session, input.field, input.component, input.values, input.stride_bytes, "input",
                 opened.required_columns, others);
    if (!contains(fields, static_cast<Field>(input.field))) fields.push_back(static_cast<Field>(input.field));
  }
  for (const Field field : fields) {
    const std::uint32_t components =
        field != Field::kNodeId && wire::is_tangential(field) ? opened.tangential_components : 1;
    for (std::uint32_t component = 0; component < components; ++component) {
      const auto found = std::ranges::count_if(inputs, [&](const shearbus_input& input) {
        return static_cast<Field>(input.field) == field && input.component == component;
      });
      if (found != 1 && field != Field::kNodeId)
        refuse(Code::kShape,
               fmt::format("{} is given {} times, expected once",
                           column_name(static_cast<std::uint32_t>(field), component), found),
               components == 1 ? "Give every column once."
                               : "The scene has tangential_components = 2: give components 0 and 1 of a column, once.",
               wire::name(field));
    }
  }
  return fields;
}

// True if ClosureCheck may compare the request of the next step with the answer to this one. The present step must then
// ask for the columns that the check reads.
bool watches_closure(const shearbus_session& handle) {
  // `steps` counts answered steps, so a call that is repeated for want of an answer asks for the same columns. The
  // bound is one step longer than that of the check.
  constexpr std::uint64_t kStepsWatched = ClosureCheck::kStepsWatched + 1;
  const CheckClosure check = handle.session->connection->options().check_closure;
  return check != CheckClosure::kOff && handle.session->opened.strategy == wire::Strategy::kForceDriven &&
         (check == CheckClosure::kError || handle.steps < kStepsWatched);
}

// Prepares the step in the session: its batch with the values of the inputs, the wanted columns, and the outputs.
StepOptions prepare(shearbus_session& handle, const shearbus_request& request) {
  Session& session = *handle.session;
  if (request.mode != SHEARBUS_ADVANCE && request.mode != SHEARBUS_TRIAL)
    refuse(Code::kInvalidValue,
           fmt::format("mode is {}, expected SHEARBUS_ADVANCE (0) or SHEARBUS_TRIAL (1)", request.mode),
           "Set the mode of the step.", "mode");
  const bool some = request.node_ids != nullptr;
  if (!some && request.n != session.node_ids.size())
    refuse(Code::kShape, fmt::format("n is {}, and the session has {} nodes", request.n, session.node_ids.size()),
           "Give one row per node, or name the node of each row in node_ids.", "n");
  const auto inputs = values_of(request.inputs, request.n_inputs, "inputs");
  const auto outputs = values_of(request.outputs, request.n_outputs, "outputs");
  std::vector<Field> fields = fields_of(session, inputs, some);
  std::vector<Field> wanted;
  for (const shearbus_output& output : outputs) {
    check_column(session, output.field, output.component, output.values, output.stride_bytes, "output",
                 session.opened.reply_columns, session.opened.columns_on_request);
    if (!contains(wanted, static_cast<Field>(output.field))) wanted.push_back(static_cast<Field>(output.field));
  }
  if (fields != handle.batch_fields || request.n != handle.batch_rows) {
    handle.batch = Batch::of(fields, request.n, session.opened.tangential_components);
    handle.batch.lend();
    handle.batch_fields = std::move(fields);
    handle.batch_rows = request.n;
  }
  if (some) std::copy_n(request.node_ids, request.n, handle.batch.u64(Field::kNodeId).begin());
  for (const shearbus_input& input : inputs) {
    const auto to = handle.batch.f64(static_cast<Field>(input.field), input.component);
    const auto* from = reinterpret_cast<const char*>(input.values);
    const std::ptrdiff_t stride = input.stride_bytes == 0 ? std::ptrdiff_t{sizeof(double)} : input.stride_bytes;
    if (stride == sizeof(double)) {
      if (!to.empty()) std::memcpy(to.data(), from, to.size_bytes());
      continue;
    }
    for (double& value : to) {
      std::memcpy(&value, from, sizeof value);
      from += stride;
    }
  }
  handle.outputs.assign(outputs.begin(), outputs.end());
  if (!wanted.empty() && watches_closure(handle))
    for (const Field field : {Field::kVelocityJumpNew, Field::kShearStress, Field::kOutcome})
      if (!contains(wanted, field)) wanted.push_back(field);
  return {.dt_s = request.dt_s,
          .time_s = request.time_s,
          .step = request.step,
          .attempt = request.attempt,
          .mode = request.mode == SHEARBUS_TRIAL ? wire::Mode::kTrial : wire::Mode::kAdvance,
          .commit_previous = request.commit_previous != 0,
          .wanted = std::move(wanted),
          .policy = request.all_or_nothing != 0 ? Policy::kAllOrNothing : Policy::kAccept,
          .absent_nodes = request.open_absent != 0 ? AbsentNodes::kOpen : AbsentNodes::kKeep};
}

// Makes a call with the columns of the present step. One that fails may leave its request on the way to a server of this
// process, which reads the columns where they are: the next step gets columns of its own.
template <typename Call>
decltype(auto) with_columns(shearbus_session& handle, const Call& call) {
  try {
    return call();
  } catch (...) {
    handle.batch_fields.clear();  // the batch of the next step is made anew
    throw;
  }
}

template <typename T>
void copy_out(std::span<const T> from, const shearbus_output& output) {
  auto* to = static_cast<char*>(output.values);
  const std::ptrdiff_t stride = output.stride_bytes == 0 ? std::ptrdiff_t{sizeof(T)} : output.stride_bytes;
  if (stride == sizeof(T)) {
    if (!from.empty()) std::memcpy(to, from.data(), from.size_bytes());
    return;
  }
  for (const T& value : from) {
    std::memcpy(to, &value, sizeof value);
    to += stride;
  }
}

void deliver(shearbus_session& handle, const StepResult& answer, shearbus_result* result) {
  const Batch& batch = answer.batch();
  for (const shearbus_output& output : handle.outputs) {
    const auto field = static_cast<Field>(output.field);
    if (!batch.has(field, output.component) || answer.upscale().nodes != handle.batch_rows)
      refuse(
          Code::kUnexpectedReply,
          fmt::format("the answer lacks {} of {} rows", column_name(output.field, output.component), handle.batch_rows),
          "Client and server do not agree on the protocol; tell the maintainers.");
  }
  for (const shearbus_output& output : handle.outputs) {
    const auto field = static_cast<Field>(output.field);
    if (wire::element_of(field) == wire::Element::kUint8)
      copy_out(batch.u8(field, output.component), output);
    else
      copy_out(batch.f64(field, output.component), output);
  }
  ++handle.steps;
  if (result == nullptr) return;
  const wire::Upscale& upscale = answer.upscale();
  give({.nodes = upscale.nodes,
        .flagged_nodes = upscale.flagged_nodes,
        .state_version = upscale.state_version,
        .solver_ns = upscale.solver_ns,
        .service_ns = upscale.service_ns,
        .round_trip_ns = static_cast<std::uint64_t>(answer.round_trip.count()),
        .largest_closure_m_per_s = upscale.largest_closure_m_per_s,
        .closure_node = upscale.closure_node,
        .layer_time_s = upscale.layer_time_s,
        .replayed = answer.reply.replayed},
       result);
}

// The deadline of all calls for the time of a step, which is shorter with a law of the host.
class StepDeadline {
 public:
  explicit StepDeadline(shearbus_session& handle) : handle_(handle) {
    handle.client->set_reply_deadline(std::min(handle.reply_deadline, handle.fallback->deadline()));
  }
  StepDeadline(const StepDeadline&) = delete;
  StepDeadline& operator=(const StepDeadline&) = delete;
  ~StepDeadline() { handle_.client->set_reply_deadline(handle_.reply_deadline); }

 private:
  shearbus_session& handle_;
};

// Makes a step by `ask`, or by the host's law where the server is gone.
template <typename Ask>
void step_or_fall_back(shearbus_session& handle, const shearbus_request& given, shearbus_result* result,
                       const Ask& ask) {
  Fallback& fallback = *handle.fallback;
  if (fallback.waits()) return tell(handle, fallback.answer(given, fallback.fault(), {}, result));
  StepOptions options;
  bool asked = false;
  try {
    const StepDeadline deadline(handle);
    session_of(&handle);  // completes the step in doubt
    if (fallback.away()) handle.session->forget_answers();
    options = prepare(handle, given);
    asked = true;
    ask(options);
  } catch (const Error& fault) {
    if (!Fallback::is_gone(fault.status().code)) throw;
    std::optional<StepInDoubt> doubt;
    if (asked && fault.status().code == Code::kUnknownOutcome)
      doubt.emplace(StepInDoubt{std::move(handle.batch), options});
    if (doubt) handle.batch_fields.clear();  // the batch of the next step is made anew
    return tell(handle, fallback.answer(given, fault.status(), std::move(doubt), result));
  }
  tell(handle, fallback.came_back());
}

void check_result(const shearbus_result* result) {
  if (result != nullptr) known(result, "shearbus_result");
}

}  // namespace

int shearbus_step(shearbus_session* session, const shearbus_request* request, shearbus_result* result,
                  shearbus_status* status) {
  return guarded(session, status, [&] {
    session_of(static_cast<const shearbus_session*>(session));
    const shearbus_request given = known(request, "shearbus_request");
    check_result(result);
    const auto ask = [&](const StepOptions& options) {
      const auto step = [&]() -> const StepResult& { return session->session->step(session->batch, options); };
      deliver(*session, with_columns(*session, step), result);
    };
    const bool may_fall_back = session->fallback && session->fallback->allowed();
    if (may_fall_back && given.mode == SHEARBUS_ADVANCE && !session->started)
      return step_or_fall_back(*session, given, result, ask);
    session_of(session);
    try {
      ask(prepare(*session, given));
    } catch (const Error& fault) {
      wire::Status status_of_fault = fault.status();
      if (may_fall_back || session->ignores_environment || environment("SHEARBUS_FALLBACK").empty() ||
          !Fallback::is_gone(status_of_fault.code))
        throw;
      status_of_fault.remedy +=
          " SHEARBUS_FALLBACK is set, but this host has no friction law of its own to go on with.";
      throw Error(std::move(status_of_fault));
    }
  });
}

int shearbus_set_fallback(shearbus_session* session, shearbus_fallback_fn law, void* user, shearbus_status* status) {
  return guarded(session, status, [&] {
    session_of(static_cast<const shearbus_session*>(session));  // a step in doubt stays in doubt
    const auto patience = fallback_patience(session->ignores_environment ? "" : environment("SHEARBUS_FALLBACK"));
    if (!session->fallback) session->fallback.emplace();
    session->fallback->use(patience ? law : nullptr, user, patience.value_or(std::chrono::milliseconds(0)));
  });
}

int shearbus_count_fallbacks(const shearbus_session* session, shearbus_fallbacks* fallbacks, shearbus_status* status) {
  return guarded(session, status, [&] {
    session_of(session);
    known(fallbacks, "shearbus_fallbacks");
    shearbus_fallbacks totals = SHEARBUS_FALLBACKS_INIT;
    if (session->fallback) totals = session->fallback->totals();
    totals.allowed = session->fallback && session->fallback->allowed();
    give(totals, fallbacks);
  });
}

int shearbus_start(shearbus_session* session, const shearbus_request* request, shearbus_status* status) {
  return guarded(session, status, [&] {
    Session& open = session_of(session);
    const shearbus_request given = known(request, "shearbus_request");
    const StepOptions options = prepare(*session, given);
    with_columns(*session, [&] { open.start(session->batch, options); });
    session->started = true;
  });
}

int shearbus_finish(shearbus_session* session, shearbus_result* result, shearbus_status* status) {
  return guarded(session, status, [&] {
    Session& open = session_of(session, true);
    check_result(result);
    session->started = false;
    deliver(*session, with_columns(*session, [&]() -> const StepResult& { return open.finish(); }), result);
  });
}

int shearbus_profiles(shearbus_session* session, size_t n, const uint64_t* node_ids, const double* pressure_pa,
                      const shearbus_output* outputs, size_t n_outputs, size_t* vertices, shearbus_status* status) {
  return guarded(session, status, [&] {
    if (vertices == nullptr)
      refuse(Code::kInvalidValue, "vertices is NULL", "Give the room of the arrays, in vertices.", "vertices");
    const auto ids = values_of(node_ids, n, "node_ids");
    if (n_outputs > 0 && outputs == nullptr)
      refuse(Code::kInvalidValue, "outputs is NULL", "Give n_outputs outputs.", "outputs");
    const std::span<const shearbus_output> wanted(outputs, n_outputs);
    for (const shearbus_output& output : wanted) {
      if (output.values == nullptr)
        refuse(Code::kInvalidValue, "the values of an output are NULL", "Give an array.", "outputs");
      const wire::ColumnRow* row = wire::find_column(static_cast<Field>(output.field));
      if (row == nullptr || row->kind != wire::Kind::kProfile || output.component > (row->tangential ? 1U : 0U))
        refuse(Code::kShape,
               fmt::format("column {} with component {} is none of a profile", output.field, output.component),
               "Ask for SHEARBUS_POSITION to SHEARBUS_LAYER_SHEAR_STRESS.", "outputs");
      check_stride(output.field, output.component, output.stride_bytes);
    }
    const std::size_t room = *vertices;
    const Received answer = session_of(session).profiles(ids, std::span(pressure_pa, pressure_pa == nullptr ? 0 : n));
    const auto& profiles = std::get<wire::Profiles>(answer.reply.body);
    *vertices = profiles.vertices;
    if (room < profiles.vertices && n_outputs > 0)
      refuse(Code::kShape,
             fmt::format("a profile has {} vertices, and the arrays have room for {}", profiles.vertices, room),
             "Make the arrays larger, and make the call again.", "vertices");
    for (const shearbus_output& output : wanted) {
      const auto values = answer.reply.batch.f64(static_cast<Field>(output.field), output.component);
      const std::ptrdiff_t stride = output.stride_bytes == 0 ? std::ptrdiff_t{sizeof(double)} : output.stride_bytes;
      auto* at = static_cast<char*>(output.values);
      for (std::size_t row = 0; row < profiles.nodes * profiles.vertices; ++row, at += stride) {
        const double value = values.empty() ? std::numeric_limits<double>::quiet_NaN() : values[row];
        std::memcpy(at, &value, sizeof value);
      }
    }
  });
}
