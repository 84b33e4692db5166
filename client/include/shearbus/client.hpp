// The C++ interface of the shearbus subgrid service, for C++17 and later: classes over the C interface, in this header
// alone, so that a host needs no other library than libshearbus.so, whichever compiler made it.
//
//   shearbus::Options options;
//   options.scene_file = "friction.toml";
//   shearbus::Session bus(options, node_ids);
//   shearbus::Step step(node_ids.size());                    // columns are arrays of the host
//   step.in(SHEARBUS_VELOCITY_JUMP, jump).in(SHEARBUS_PRESSURE, pressure) ...
//   step.out(SHEARBUS_SHEAR_STRESS, stress);
//   bus.step(step.dt(1e-9));
//   bus.close();
//
// Faults throw shearbus::Error. What shearbus.h says of codes, repeated calls, deadlines, threads, units and
// environment variables holds here, too.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#ifndef SHEARBUS_H  // shearbus_stub.h stands for it in a program without the library
#include "shearbus/shearbus.h"
#endif

namespace shearbus {
inline namespace v1 {

// A fault: its code, such as SHEARBUS_INVALID_VALUE; text(): what was expected and found; remedy(): what to do; field()
// and nodes(): the column or key and the nodes at fault.
class Error : public std::runtime_error {
 public:
  // whole: the text, of which that of the status may be the beginning.
  explicit Error(const shearbus_status& status, const std::string& whole = {})
      : Error(std::make_shared<const Fault>(Fault{status, text_of(status, whole)})) {}

  // Makes the Error of a fault that a C++ header finds before it calls the C interface.
  static Error of(int code, const std::string& field, const std::string& text) {
    shearbus_status status = SHEARBUS_STATUS_INIT;
    const auto put = [](const std::string& from, char* to, std::size_t size) { to[from.copy(to, size - 1)] = '\0'; };
    status.code = code;
    put(text, status.text, sizeof status.text);
    put(field, status.field, sizeof status.field);
    return Error(status);
  }

  const shearbus_status& status() const noexcept { return fault_->status; }
  int code() const noexcept { return status().code; }
  std::string text() const { return fault_->text; }
  std::string remedy() const { return status().remedy; }
  std::string field() const { return status().field; }
  std::vector<std::uint64_t> nodes() const { return {status().nodes, status().nodes + status().n_nodes}; }

 private:
  struct Fault {
    shearbus_status status;
    std::string text;
  };
  explicit Error(std::shared_ptr<const Fault> fault)
      : std::runtime_error(std::string(shearbus_code_name(fault->status.code)) + ": " + fault->text +
                           (fault->status.remedy[0] == '\0' ? "" : std::string(" (") + fault->status.remedy + ")")),
        fault_(std::move(fault)) {}
  static std::string text_of(const shearbus_status& status, const std::string& whole) {
    const std::string text = status.text;
    const std::size_t begin = text.size() < 3 ? 0 : text.size() - 3;  // of the "..." of a text that was cut
    return text.substr(begin) == "..." && whole.compare(0, begin, text, 0, begin) == 0 ? whole : text;
  }
  std::shared_ptr<const Fault> fault_;  // shared, since copying an exception must not throw
};

// Calls function(arguments..., &status), and throws the fault that it reports as an Error.
template <typename Function, typename... Arguments>
void call(Function function, Arguments... arguments) {
  shearbus_status status = SHEARBUS_STATUS_INIT;
  if (function(arguments..., &status) != SHEARBUS_OK) throw Error(status, shearbus_fault_text());
}

struct Options {
  // tcp://host:port, ipc://path, file://path; a list of them with commas, or file://path of a directory of endpoint
  // files: several servers; empty or "embedded": a server in this process
  std::string endpoint;
  std::string scene_file;  // path of a TOML file; set either scene_file or scene_text
  std::string scene_text;
  std::string scene_name;  // name of scene_text in messages; empty: "scene_text"
  std::string domain;      // node ids are unique among the sessions of a domain; empty: within this session only
  std::string name = "C++ host";
  std::string server_key_file;
  std::string secret_key_file;
  double connect_deadline_s = 0.0;  // for each of these three times 0 means the default of shearbus.h
  double reply_deadline_s = 0.0;
  double retry_after_s = 0.0;
  std::function<void(const std::string& line)> log;  // gets the opened session, warnings, and what a call waits for
  std::string state_dir;                             // embedded: directory of a durable server's states
  std::uint32_t threads = 0;                         // embedded: number of threads that solve layers; 0: one
  int check_closure = SHEARBUS_CHECK_WARN;
  std::uint64_t idle_limit_s = 0;     // the server closes the session after this time without a request; 0: never
  std::function<bool()> interrupted;  // asked while a call waits; true: the call ends as if its deadline had passed
  bool ignore_environment = false;    // the environment variables of shearbus.h replace nothing
};

namespace detail {

struct Callbacks {  // of Options, at an address that stays
  std::function<void(const std::string&)> log;
  std::function<bool()> interrupted;
};

// The options as a struct of the C interface, which points into both arguments.
inline shearbus_options as_c(const Options& options, Callbacks& callbacks) {
  const auto text_or_null = [](const std::string& text) { return text.empty() ? nullptr : text.c_str(); };
  shearbus_options given = SHEARBUS_OPTIONS_INIT;
  given.endpoint = text_or_null(options.endpoint);
  given.scene_file = text_or_null(options.scene_file);
  given.scene_text = text_or_null(options.scene_text);
  given.domain = text_or_null(options.domain);
  given.name = text_or_null(options.name);
  given.server_key_file = text_or_null(options.server_key_file);
  given.secret_key_file = text_or_null(options.secret_key_file);
  given.connect_deadline_s = options.connect_deadline_s;
  given.reply_deadline_s = options.reply_deadline_s;
  given.retry_after_s = options.retry_after_s;
  given.state_dir = text_or_null(options.state_dir);
  given.threads = options.threads;
  given.check_closure = options.check_closure;
  given.idle_limit_s = options.idle_limit_s;
  given.scene_name = text_or_null(options.scene_name);
  given.ignore_environment = options.ignore_environment ? 1 : 0;
  if (callbacks.log) {
    given.log = [](void* user, const char* line) { static_cast<Callbacks*>(user)->log(line); };
    given.log_user = &callbacks;
  }
  if (callbacks.interrupted) {
    given.interrupted = [](void* user) { return static_cast<Callbacks*>(user)->interrupted() ? 1 : 0; };
    given.interrupted_user = &callbacks;
  }
  return given;
}

// Values of which there is one per node, or none: NULL.
inline const double* per_node(const std::vector<double>& values, std::size_t nodes, const char* name) {
  if (!values.empty() && values.size() != nodes)
    throw std::invalid_argument(std::string(name) + ": give one value per node, or none");
  return values.empty() ? nullptr : values.data();
}

}  // namespace detail

// The columns of one step. A Step keeps pointers to arrays of the host, which must stay where they are. in() and out()
// take containers with data() and size() and one value per row; in_strided() and out_strided() take values that lie
// stride_bytes apart.
class Step {
 public:
  explicit Step(std::size_t rows) { request_.n = rows; }
  // A step of some nodes of the session. The vector of their ids, like the columns, must outlive the Step.
  explicit Step(const std::vector<std::uint64_t>& node_ids) : Step(node_ids.size()) {
    request_.node_ids = node_ids.data();
  }

  Step& in_strided(std::uint32_t field, const double* values, std::ptrdiff_t stride_bytes,
                   std::uint32_t component = 0) {
    inputs_.push_back({field, component, values, stride_bytes});
    return *this;
  }
  template <typename Values>
  Step& in(std::uint32_t field, Values& values, std::uint32_t component = 0) {
    static_assert(std::is_same_v<std::remove_cv_t<std::remove_pointer_t<decltype(values.data())>>, double>,
                  "the inputs of a step are doubles");
    return in_strided(field, checked(field, values.data(), values.size()), 0, component);
  }
  Step& out_strided(std::uint32_t field, void* values, std::ptrdiff_t stride_bytes, std::uint32_t component = 0) {
    outputs_.push_back({field, component, values, stride_bytes});
    return *this;
  }
  template <typename Values>
  Step& out(std::uint32_t field, Values& values, std::uint32_t component = 0) {
    using Value = std::remove_pointer_t<decltype(values.data())>;
    static_assert(std::is_same_v<Value, double> || std::is_same_v<Value, std::uint8_t>,
                  "the outputs of a step are doubles, the regime and the outcome std::uint8_t");
    const bool is_byte = field == SHEARBUS_REGIME || field == SHEARBUS_OUTCOME;
    if (is_byte != std::is_same_v<Value, std::uint8_t>)
      refuse(SHEARBUS_SHAPE, field,
             is_byte ? "the column has values of std::uint8_t" : "the column has values of double");
    return out_strided(field, checked(field, values.data(), values.size()), 0, component);
  }

  Step& dt(double seconds) { return request_.dt_s = seconds, *this; }
  Step& time(double end_s) { return request_.time_s = end_s, *this; }
  Step& number(std::uint64_t step, std::uint32_t attempt = 0) {
    return request_.step = step, request_.attempt = attempt, *this;
  }
  Step& commit_previous(bool yes) { return request_.commit_previous = yes, *this; }
  Step& open_absent(bool yes) { return request_.open_absent = yes, *this; }
  Step& all_or_nothing(bool yes) { return request_.all_or_nothing = yes, *this; }

  // The step as a struct of the C interface, which points into this object.
  shearbus_request request(int mode) const {
    shearbus_request request = request_;
    request.mode = mode;
    request.inputs = inputs_.data();
    request.n_inputs = inputs_.size();
    request.outputs = outputs_.data();
    request.n_outputs = outputs_.size();
    return request;
  }

 private:
  [[noreturn]] static void refuse(int code, std::uint32_t field, const std::string& text) {
    const char* name = shearbus_field_name(field);
    throw Error::of(code, name == nullptr ? "" : name,
                    (name == nullptr ? "column " + std::to_string(field) : name) + std::string(": ") + text);
  }
  template <typename Value>
  Value* checked(std::uint32_t field, Value* values, std::size_t size) const {
    if (size != request_.n)
      refuse(SHEARBUS_SHAPE, field, std::to_string(size) + " values, expected " + std::to_string(request_.n));
    return values;
  }
  shearbus_request request_ = SHEARBUS_REQUEST_INIT;
  std::vector<shearbus_input> inputs_;
  std::vector<shearbus_output> outputs_;
};

using Ids = std::vector<std::uint64_t>;

// Nodes of several material pairs, or with parameters of their own. Each list has one value per node or is empty.
struct Nodes {
  Ids ids;
  std::vector<double> initial_temperature_k;  // empty: the scene's value
  std::vector<std::string> pair;              // a table [pair.NAME] of the scene, or "": the tables outside of them
  // Keys of the scene, as "interface.friction_coefficient", each with its values; shearbus.h says more.
  std::vector<std::pair<std::string, std::vector<double>>> parameters;

  // Returns use(nodes), called with the nodes as a struct of the C interface.
  template <typename Use>
  auto as_c(const Use& use) const {
    const auto check = [&](std::size_t size, const std::string& what) {
      if (size != 0 && size != ids.size()) throw std::invalid_argument(what + ": give one value per node, or none");
    };
    check(pair.size(), "pair");
    std::vector<const char*> names, keys;
    std::vector<std::uint64_t> places;
    std::vector<const double*> values;
    for (const std::string& name : pair) {
      std::size_t place = 0;
      while (place < names.size() && name != names[place]) ++place;
      if (place == names.size()) names.push_back(name.c_str());
      places.push_back(place);
    }
    for (const auto& parameter : parameters) {
      check(parameter.second.empty() ? ids.size() + 1 : parameter.second.size(), parameter.first);
      keys.push_back(parameter.first.c_str());
      values.push_back(parameter.second.data());
    }
    shearbus_nodes nodes = SHEARBUS_NODES_INIT;
    nodes.n = ids.size();
    nodes.node_ids = ids.data();
    nodes.initial_temperature_k = detail::per_node(initial_temperature_k, ids.size(), "initial_temperature_k");
    nodes.n_pairs = names.size();
    nodes.pairs = names.data();
    nodes.pair = places.data();
    nodes.n_parameters = keys.size();
    nodes.parameters = keys.data();
    nodes.values = values.data();
    return use(static_cast<const shearbus_nodes*>(&nodes));
  }
};
using TransferId = std::array<std::uint8_t, SHEARBUS_TRANSFER_BYTES>;

// Profiles of nodes across the layer. Each column has the shape [nodes][vertices], with the vertices in ascending z.
struct Profiles {
  struct Column {
    std::uint32_t field = 0;
    std::uint32_t component = 0;
    std::vector<double> values;
  };
  std::size_t nodes = 0;
  std::size_t vertices = 0;
  std::vector<Column> columns;

  static std::vector<std::uint32_t> fields(std::uint32_t tangential_components) {
    std::vector<std::uint32_t> all = {SHEARBUS_POSITION,          SHEARBUS_WIDTH,
                                      SHEARBUS_LAYER_TEMPERATURE, SHEARBUS_LAYER_PLASTIC_STRAIN,
                                      SHEARBUS_LAYER_FLOW_STRESS, SHEARBUS_LAYER_SHEAR_STRESS};
    if (tangential_components == 2) all.push_back(SHEARBUS_LAYER_SHEAR_STRESS);
    return all;
  }
  // The values of a column, such as SHEARBUS_LAYER_TEMPERATURE. Throws std::out_of_range for any other column.
  const std::vector<double>& operator()(std::uint32_t field, std::uint32_t component = 0) const {
    for (const Column& column : columns)
      if (column.field == field && column.component == component) return column.values;
    throw std::out_of_range("no column of these profiles");
  }
};

// A session. Its destructor leaves it open on the server, to be resumed with its ticket; close() ends it there.
class Session {
 public:
  Session(const Options& options, const Ids& node_ids, const std::vector<double>& initial_temperature_k = {})
      : callbacks_(callbacks_of(options)) {
    const double* temperatures = detail::per_node(initial_temperature_k, node_ids.size(), "initial_temperature_k");
    open(
        [&](shearbus_session** handle, const shearbus_options* given, shearbus_status* status) {
          return shearbus_open(handle, given, node_ids.size(), node_ids.data(), temperatures, status);
        },
        options);
  }
  // Returns the session that the function opening(&handle, &c_options, &status) opens by a call of the C interface.
  template <typename Opening>
  static Session open_by(const Options& options, const Opening& opening) {
    Session session(callbacks_of(options));
    session.open(opening, options);
    return session;
  }
  // A session of nodes of several material pairs, or with parameters of their own.
  static Session open_nodes(const Options& options, const Nodes& nodes) {
    return nodes.as_c([&](const shearbus_nodes* of) {
      return open_by(options, [&](shearbus_session** handle, const shearbus_options* given, shearbus_status* status) {
        return shearbus_open_nodes(handle, given, of, status);
      });
    });
  }
  static Session resume(const Options& options, const std::string& ticket) {
    return open_by(options, [&](shearbus_session** handle, const shearbus_options* given, shearbus_status* status) {
      return shearbus_resume(handle, given, ticket.c_str(), status);
    });
  }
  // For a host that knows its nodes: throws where those of the session are others, or have other pairs or parameters.
  static Session resume(const Options& options, const std::string& ticket, const Nodes& nodes) {
    return nodes.as_c([&](const shearbus_nodes* of) {
      return open_by(options, [&](shearbus_session** handle, const shearbus_options* given, shearbus_status* status) {
        return shearbus_resume_nodes(handle, given, ticket.c_str(), of, status);
      });
    });
  }
  Session(Session&& other) noexcept
      : callbacks_(std::move(other.callbacks_)),
        law_(std::move(other.law_)),
        handle_(std::exchange(other.handle_, nullptr)) {}
  Session& operator=(Session&& other) noexcept {
    std::swap(callbacks_, other.callbacks_);
    std::swap(law_, other.law_);
    std::swap(handle_, other.handle_);
    return *this;
  }
  ~Session() { shearbus_leave(&handle_); }

  shearbus_result step(const Step& step) { return run(step, SHEARBUS_ADVANCE); }  // commits the new states
  shearbus_result trial(const Step& step) { return run(step, SHEARBUS_TRIAL); }   // commit() or rollback() follows
  // start() sends a step, finish() waits for its answer. The arrays of the outputs must exist until finish() returns. A
  // step that was started and then left may run or not.
  void start(const Step& step, int mode = SHEARBUS_ADVANCE) {
    const shearbus_request request = step.request(mode);
    call(shearbus_start, handle_, &request);
  }
  shearbus_result finish() {
    shearbus_result result = SHEARBUS_RESULT_INIT;
    call(shearbus_finish, handle_, &result);
    return result;
  }
  // The host's own law, for steps while the server is gone, where the user allows it (shearbus_set_fallback): it fills the
  // outputs of the request. If it throws, it has no answer, and the step fails.
  using Law = std::function<void(const shearbus_request& request)>;
  void set_fallback(Law law) {
    auto kept = std::make_unique<Law>(std::move(law));
    const bool none = !*kept;
    const shearbus_fallback_fn function = [](void* user, const shearbus_request* request) noexcept {
      try {
        (*static_cast<Law*>(user))(*request);
        return 0;
      } catch (...) {
        return 1;
      }
    };
    call(shearbus_set_fallback, handle_, none ? nullptr : function, static_cast<void*>(kept.get()));
    law_ = std::move(kept);
  }
  shearbus_fallbacks fallbacks() const {
    shearbus_fallbacks totals = SHEARBUS_FALLBACKS_INIT;
    call(shearbus_count_fallbacks, static_cast<const shearbus_session*>(handle_), &totals);
    return totals;
  }
  void commit() { call(shearbus_commit, handle_); }
  void rollback() { call(shearbus_rollback, handle_); }
  void mark(const std::string& name) { call(shearbus_mark, handle_, name.c_str()); }
  void rollback_to(const std::string& name) { call(shearbus_rollback_to, handle_, name.c_str()); }

  // The profiles of some nodes across the layer, from their committed states; shearbus.h says what they hold.
  // pressure_pa: P at which the flow stress is evaluated, one value per node; empty: 0.
  Profiles profiles(const Ids& ids, const std::vector<double>& pressure_pa = {}) {
    const double* pressures = detail::per_node(pressure_pa, ids.size(), "pressure_pa");
    Profiles profiles;
    profiles.nodes = ids.size();
    call(shearbus_profiles, handle_, ids.size(), ids.data(), pressures, static_cast<const shearbus_output*>(nullptr),
         std::size_t{0}, &profiles.vertices);
    std::vector<shearbus_output> outputs;
    for (const std::uint32_t field : Profiles::fields(info().tangential_components)) {
      const std::uint32_t component = !outputs.empty() && outputs.back().field == field ? 1 : 0;
      profiles.columns.push_back({field, component, std::vector<double>(profiles.nodes * profiles.vertices)});
      outputs.push_back({field, component, profiles.columns.back().values.data(), 0});
    }
    call(shearbus_profiles, handle_, ids.size(), ids.data(), pressures,
         static_cast<const shearbus_output*>(outputs.data()), outputs.size(), &profiles.vertices);
    return profiles;
  }

  void register_nodes(const Ids& ids, const std::vector<double>& initial_temperature_k = {}) {
    call(shearbus_register, handle_, ids.size(), ids.data(),
         detail::per_node(initial_temperature_k, ids.size(), "initial_temperature_k"));
  }
  void add_nodes(const Nodes& nodes) {  // register_nodes() for such nodes
    nodes.as_c([&](const shearbus_nodes* of) { call(shearbus_register_nodes, handle_, of); });
  }
  void retire_nodes(const Ids& ids) { call(shearbus_retire, handle_, ids.size(), ids.data()); }
  TransferId offer_nodes(const Ids& ids) {
    TransferId transfer{};
    call(shearbus_offer, handle_, ids.size(), ids.data(), transfer.data());
    return transfer;
  }
  void accept_nodes(const TransferId& transfer) { call(shearbus_accept, handle_, transfer.data()); }
  std::vector<TransferId> offers() const {
    std::vector<TransferId> all(shearbus_offers(handle_, 0, nullptr));
    static_assert(sizeof(TransferId) == SHEARBUS_TRANSFER_BYTES);
    shearbus_offers(handle_, all.size(), reinterpret_cast<std::uint8_t(*)[SHEARBUS_TRANSFER_BYTES]>(all.data()));
    return all;
  }

  std::string ticket() const {
    char text[SHEARBUS_TICKET_BYTES];
    call(shearbus_ticket, static_cast<const shearbus_session*>(handle_), static_cast<char*>(text));
    return text;
  }
  void close() { call(shearbus_close, &handle_); }
  // close() with the totals of the session. After a fault the call can be made again.
  shearbus_totals end() {
    shearbus_totals totals = SHEARBUS_TOTALS_INIT;
    call(shearbus_end, handle_, &totals);
    return totals;
  }
  // Changes Options::reply_deadline_s for all later calls.
  void set_reply_deadline(double reply_deadline_s) { call(shearbus_set_reply_deadline, handle_, reply_deadline_s); }

  Ids node_ids() const {
    const std::uint64_t* ids = shearbus_node_ids(handle_);
    return {ids, ids + shearbus_node_count(handle_)};
  }
  std::string effective_scene() const { return shearbus_effective_scene(handle_); }
  std::string warnings() const { return shearbus_warnings(handle_); }
  std::string text(int which) const { return shearbus_text(handle_, which); }  // such as SHEARBUS_SERVER_VERSION
  shearbus_info info() const {
    shearbus_info info = SHEARBUS_INFO_INIT;
    call(shearbus_inspect, static_cast<const shearbus_session*>(handle_), &info);
    return info;
  }
  std::vector<std::uint32_t> columns(int use) const {
    std::vector<std::uint32_t> fields(shearbus_columns(handle_, use, 0, nullptr));
    shearbus_columns(handle_, use, fields.size(), fields.data());
    return fields;
  }
  shearbus_session* c_handle() const noexcept { return handle_; }

 private:
  using Callbacks = detail::Callbacks;

  explicit Session(std::unique_ptr<Callbacks> callbacks) : callbacks_(std::move(callbacks)) {}
  static std::unique_ptr<Callbacks> callbacks_of(const Options& options) {
    return std::make_unique<Callbacks>(Callbacks{options.log, options.interrupted});
  }

  template <typename Opening>
  void open(const Opening& opening, const Options& options) {
    const shearbus_options given = detail::as_c(options, *callbacks_);
    shearbus_status status = SHEARBUS_STATUS_INIT;
    if (opening(&handle_, &given, &status) == SHEARBUS_OK) return;
    const Error fault(status, shearbus_fault_text());
    shearbus_leave(&handle_);
    throw Error(fault);
  }
  shearbus_result run(const Step& step, int mode) {
    const shearbus_request request = step.request(mode);
    shearbus_result result = SHEARBUS_RESULT_INIT;
    call(shearbus_step, handle_, &request, &result);
    return result;
  }

  std::unique_ptr<Callbacks> callbacks_;  // outlives the handle, and keeps its address when the session moves
  std::unique_ptr<Law> law_;
  shearbus_session* handle_ = nullptr;
};

// A connection to a server without a session, for what shearbus.h says of operators.
class Operator {
 public:
  explicit Operator(const Options& options)
      : callbacks_(std::make_unique<detail::Callbacks>(detail::Callbacks{options.log, options.interrupted})) {
    const shearbus_options given = detail::as_c(options, *callbacks_);
    call(shearbus_connect, &handle_, &given);
  }
  Operator(Operator&& other) noexcept
      : callbacks_(std::move(other.callbacks_)), handle_(std::exchange(other.handle_, nullptr)) {}
  Operator& operator=(Operator&& other) noexcept {
    std::swap(callbacks_, other.callbacks_);
    std::swap(handle_, other.handle_);
    return *this;
  }
  ~Operator() { shearbus_disconnect(&handle_); }

  // Sends a question, as of SHEARBUS_ASK_STATUS, and returns its answer as JSON.
  std::string ask(const shearbus_question& question) {
    const char* answer = nullptr;
    call(shearbus_ask, handle_, &question, &answer);
    return answer;
  }
  std::string ask(int what) {
    shearbus_question question = SHEARBUS_QUESTION_INIT;
    question.what = what;
    return ask(question);
  }

 private:
  std::unique_ptr<detail::Callbacks> callbacks_;  // outlives the handle
  shearbus_operator* handle_ = nullptr;
};

}  // namespace v1
}  // namespace shearbus
