// The C interface (client/include/shearbus/shearbus.h): the sessions of the C++ core behind functions that return
// codes. No exception leaves a function: see guarded().
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <new>
#include <optional>
#include <string_view>
#include <utility>

#include "client/include/shearbus/shearbus.h"
#include "client/src/client.hpp"
#include "client/src/closure_check.hpp"
#include "client/src/embedded_server.hpp"
#include "client/src/entry.hpp"
#include "client/src/fallback.hpp"
#include "proto/files/key_file.hpp"
#include "proto/wire/enum_names.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/text.hpp"

using namespace shearbus;

namespace {

constexpr std::size_t kLargestStruct = 4096;  // [bytes]; a larger `size` in a caller's struct is uninitialised

[[noreturn]] void refuse(Code code, std::string text, std::string remedy, std::string field = {}) {
  throw Error({.code = code, .text = std::move(text), .remedy = std::move(remedy), .field = std::move(field)});
}

// ---- structs of the caller ----

template <typename Struct>
bool has_sound_size(const Struct& given) {
  return given.size >= sizeof(Struct) && given.size <= kLargestStruct;
}

// The members of a caller's struct that this library knows. A caller that was compiled with a later header may have
// more members; it is refused if one of those is not zero.
template <typename Struct>
Struct known(const Struct* given, const char* type) {
  if (given == nullptr)
    refuse(Code::kInvalidValue, fmt::format("the {} is NULL", type), "Give a struct that starts from its _INIT.");
  if (!has_sound_size(*given))
    refuse(Code::kInvalidValue, fmt::format("{}.size is {}, expected at least {}", type, given->size, sizeof(Struct)),
           "Start the struct from its _INIT, which sets the size.");
  const auto* bytes = reinterpret_cast<const unsigned char*>(given);
  if (std::any_of(bytes + sizeof(Struct), bytes + given->size, [](unsigned char byte) { return byte != 0; }))
    refuse(Code::kUnsupported,
           fmt::format("{} has {} bytes, and this library {} knows the first {}", type, given->size, shearbus_version(),
                       sizeof(Struct)),
           "Use a library at least as new as the header that the host was compiled with.");
  return *given;
}

// Copies the values to the caller's struct, whose size has_sound_size() has checked, and keeps its `size`.
template <typename Struct>
void give(Struct values, Struct* to) {
  values.size = to->size;
  *to = values;
}

std::string_view text_or(const char* text, std::string_view otherwise = {}) {
  return text == nullptr ? otherwise : std::string_view(text);
}

// ---- status ----

// Copies a text. Of a text that is too long it copies the beginning, cut between two UTF-8 characters, and adds "...".
// Allocates no memory.
template <std::size_t kSize>
void put(std::string_view text, char (&to)[kSize]) noexcept {
  constexpr std::string_view kCut = "...";
  std::size_t length = text.size();
  if (length >= kSize) {
    length = kSize - 1 - kCut.size();
    while (length > 0 && (static_cast<unsigned char>(text[length]) & 0xC0U) == 0x80U) --length;
  }
  std::memcpy(to, text.data(), length);
  if (length < text.size()) {
    std::memcpy(to + length, kCut.data(), kCut.size());
    length += kCut.size();
  }
  to[length] = '\0';
}

int report(shearbus_status* to, int code, std::string_view text = {}, std::string_view remedy = {},
           std::string_view field = {}, std::span<const std::uint64_t> nodes = {}) noexcept {
  if (to == nullptr) return code;
  to->code = code;
  put(text, to->text);
  put(remedy, to->remedy);
  put(field, to->field);
  to->n_nodes = 0;
  for (const std::uint64_t node : nodes.first(std::min<std::size_t>(nodes.size(), SHEARBUS_NODES_NAMED)))
    to->nodes[to->n_nodes++] = node;
  return code;
}

// Runs the body of a function of the interface, and turns what it throws into a code and a status.
template <typename Body>
int guarded(shearbus_status* status, const Body& body) noexcept {
  if (status != nullptr && !has_sound_size(*status)) return SHEARBUS_INVALID_VALUE;
  const Entry entry;
  try {
    body();
    return report(status, SHEARBUS_OK);
  } catch (const WrongCaller& found) {
    return report(status, found.code, found.text, found.remedy);
  } catch (const Error& fault) {
    const Status& found = fault.status();
    return report(status, static_cast<int>(found.code), found.text, found.remedy, found.field, found.node_ids);
  } catch (const std::bad_alloc&) {
    return report(status, SHEARBUS_NO_MEMORY, "the host's process has no memory left",
                  "Free memory and make the same call again: if it has run, it is not run a second time.");
  } catch (const std::exception& fault) {
    return report(status, SHEARBUS_LIBRARY_FAULT, fault.what(),
                  "Make the same call again: if it has run, it is not run a second time.");
  } catch (...) {
    return report(status, SHEARBUS_LIBRARY_FAULT, "an unknown fault inside the client library");
  }
}

// ---- log and environment ----

std::string environment(const char* name) {
  return std::string(text_or(::secure_getenv(name)));  // NOLINT(concurrency-mt-unsafe)
}

constexpr std::size_t kLongestName = 1024;  // of a file, in a message

// Writes log lines of a session to the host's callback and to the file that SHEARBUS_LOG names.
class LineLog {
 public:
  LineLog() = default;
  LineLog(shearbus_log_fn function, void* user, std::string file)
      : function_(function), user_(user), file_(std::move(file)) {
    if (file_.empty() || file_ == "stderr") return;
    if (std::FILE* opened = std::fopen(file_.c_str(), "ae")) {
      static_cast<void>(std::fclose(opened));
      return;
    }
    fmt::print(stderr, "shearbus: SHEARBUS_LOG: {} cannot be opened: {}; it gets no lines\n",
               wire::printable(file_, kLongestName), std::strerror(errno));  // NOLINT(concurrency-mt-unsafe)
    file_.clear();
  }

  bool wanted() const { return function_ != nullptr || !file_.empty(); }
  void operator()(const std::string& line) const {
    try {
      if (function_ != nullptr) function_(user_, line.c_str());
    } catch (...) {
      // If the callback of a C++ host throws, the call that wrote the line goes on.
    }
    if (file_ == "stderr") {
      fmt::print(stderr, "shearbus: {}\n", line);
    } else if (!file_.empty()) {
      std::FILE* file = std::fopen(file_.c_str(), "ae");
      if (file == nullptr) return;
      fmt::print(file, "shearbus: {}\n", line);
      static_cast<void>(std::fclose(file));
    }
  }

 private:
  shearbus_log_fn function_ = nullptr;
  void* user_ = nullptr;
  std::string file_;
};

// ---- options ----

std::chrono::milliseconds seconds(double value, std::chrono::milliseconds otherwise, const char* name) {
  constexpr double kLongest = 1e7;
  if (value == 0.0) return otherwise;
  if (!(value > 0.0 && value <= kLongest))
    refuse(Code::kInvalidValue,
           fmt::format("{} is {}, expected a time above 0 and at most {} s", name, value, kLongest),
           "Give a time in seconds, or 0 for the default.", name);
  return std::chrono::milliseconds(std::max<long long>(1, std::llround(value * 1e3)));
}

CheckClosure check_of(int option) {
  switch (option) {
    case SHEARBUS_CHECK_WARN:
      return CheckClosure::kWarn;
    case SHEARBUS_CHECK_OFF:
      return CheckClosure::kOff;
    case SHEARBUS_CHECK_ERROR:
      return CheckClosure::kError;
    default:
      refuse(Code::kInvalidValue, fmt::format("check_closure is {}, expected 0 (warn), 1 (off) or 2 (error)", option),
             "Use 'warn', 'off' or 'error' (in C and C++ SHEARBUS_CHECK_WARN, SHEARBUS_CHECK_OFF or "
             "SHEARBUS_CHECK_ERROR).",
             "check_closure");
  }
}

struct Scene {
  std::string text;
  std::string name;  // name of the scene in messages
};

// A text of the host as messages quote it: on one line, without commands to a terminal.
std::string in_message(std::string_view text) {
  constexpr std::size_t kLongest = 4096;
  return wire::printable(text, kLongest);
}

std::string text_of_file(const std::string& path) {
  const std::string shown = in_message(path);
  const auto fail = [&] {
    if (errno == EMFILE)
      refuse(Code::kUnreachable, fmt::format("the scene {} cannot be read: {}", shown, wire::limit_of_files()), {});
    refuse(Code::kInvalidScene, fmt::format("the scene {} cannot be read: {}", shown, std::strerror(errno)),
           "Name a TOML file that this process may read.", "scene_file");
  };
  // A pipe could keep the host waiting, and a device has no end.
  const int descriptor = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
  struct stat found {};
  std::FILE* file = descriptor >= 0 ? ::fdopen(descriptor, "r") : nullptr;
  if (file == nullptr) fail();
  const auto close = [](std::FILE* open) { static_cast<void>(std::fclose(open)); };
  const std::unique_ptr<std::FILE, decltype(close)> owner(file, close);
  if (::fstat(descriptor, &found) == 0 && !S_ISREG(found.st_mode) && !S_ISDIR(found.st_mode))
    refuse(Code::kInvalidScene, fmt::format("the scene {} is a pipe or a device, expected a file", shown),
           "Name a TOML file that this process may read.", "scene_file");
  std::string text(wire::kMaxSceneBytes + 1, '\0');
  errno = 0;
  text.resize(std::fread(text.data(), 1, text.size(), file));
  if (std::ferror(file) != 0) fail();
  if (text.size() > wire::kMaxSceneBytes)
    refuse(Code::kLimit, fmt::format("the scene {} has more than {} bytes", shown, wire::kMaxSceneBytes),
           "Is it a TOML file?", "scene_file");
  return text;
}

Scene scene_of(const shearbus_options& options) {
  const std::string override_file = environment("SHEARBUS_SCENE");
  const std::string file = override_file.empty() ? std::string(text_or(options.scene_file)) : override_file;
  const bool has_text = options.scene_text != nullptr && override_file.empty();
  if (has_text == !file.empty())
    refuse(Code::kInvalidScene,
           has_text ? "the options have both scene_file and scene_text" : "the options have no scene",
           "Set either scene_file or scene_text.", "scene_file");
  if (has_text) return {.text = options.scene_text, .name = "scene_text"};
  return {.text = text_of_file(file), .name = file};
}

bool is_embedded(const std::string& endpoint) {
  return endpoint.empty() || endpoint == "embedded";
}

const char* reading(const char* file, std::string (*read)(const std::filesystem::path&), std::string& key) {
  try {
    key = read(file);
  } catch (const std::runtime_error& fault) {
    refuse(Code::kAuth, fault.what(), "shearbus-ctl keygen makes a pair of key files.");
  }
  return key.c_str();
}

// ---- tickets: texts with which a session can be resumed ----

template <std::size_t kSize>
char* to_hex(const std::array<std::uint8_t, kSize>& bytes, char* at) {
  for (const std::uint8_t byte : bytes) at = fmt::format_to(at, "{:02x}", byte);
  return at;
}

bool from_hex(std::string_view digits, std::span<std::uint8_t> bytes) {
  if (digits.size() != 2 * bytes.size()) return false;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    const char* first = digits.data() + 2 * i;
    if (std::from_chars(first, first + 2, bytes[i], 16).ptr != first + 2) return false;
  }
  return true;
}

// A ticket that was read from a file may have the file's line end, and one of Fortran blanks.
Session::Ticket ticket_of(std::string_view text) {
  text = text.substr(0, text.find_last_not_of(" \t\r\n\v\f") + 1);
  constexpr std::size_t kDigits = 2 * wire::kSessionIdBytes;
  Session::Ticket ticket;
  if (text.size() != 2 * kDigits + 1 || text[kDigits] != ':' || !from_hex(text.substr(0, kDigits), ticket.session_id) ||
      !from_hex(text.substr(kDigits + 1), ticket.resume_token))
    refuse(Code::kInvalidValue,
           fmt::format("the ticket is no ticket: {} characters, expected {} of which 64 are hexadecimal digits",
                       text.size(), 2 * kDigits + 1),
           "Give the ticket of the session unchanged.", "ticket");
  return ticket;
}

template <typename T>
std::span<const T> values_of(const T* values, std::size_t n, const char* name) {
  if (n > 0 && values == nullptr)
    refuse(Code::kInvalidValue, fmt::format("{} is NULL for {} nodes", name, n), "Give one value per node.", name);
  return {values, n};
}

// The properties of new nodes. Names of pairs, keys and arrays of parameters must be there where their number says so.
NodeOptions properties_of(const shearbus_nodes& nodes) {
  NodeOptions properties;
  if (nodes.initial_temperature_k != nullptr) properties.initial_temperature_k = {nodes.initial_temperature_k, nodes.n};
  for (const char* const name : values_of(nodes.pairs, nodes.n_pairs, "pairs"))
    properties.pairs.emplace_back(text_or(name));
  if (nodes.n_pairs > 0) properties.pair = values_of(nodes.pair, nodes.n, "pair");
  const auto keys = values_of(nodes.parameters, nodes.n_parameters, "parameters");
  const auto values = values_of(nodes.values, nodes.n_parameters, "values");
  for (std::size_t i = 0; i < keys.size(); ++i) {
    std::string key(text_or(keys[i]));
    properties.parameters.push_back({key, values_of(values[i], nodes.n, key.c_str())});
  }
  return properties;
}

// ---- what a session tells of itself ----

std::string lines(std::span<const std::string> texts) {
  std::string all;
  for (const std::string& text : texts) all += text + '\n';
  return all;
}

using SessionTexts = std::array<std::string, SHEARBUS_ACCESS + 1>;  // by the numbers of shearbus_text()

SessionTexts texts_of(const Client& client, const Session& session) {
  const wire::Welcome& welcome = client.welcome();
  SessionTexts texts;
  texts[SHEARBUS_SCENE_NAME] = session.opened().scene_name;
  texts[SHEARBUS_PAIR_NAMES] = lines(session.opened().pairs);
  texts[SHEARBUS_PARAMETER_KEYS] = lines(session.opened().parameters);
  texts[SHEARBUS_SERVER_VERSION] = welcome.server_version;
  texts[SHEARBUS_CAPABILITIES] = lines(welcome.capabilities);
  texts[SHEARBUS_DURABILITY] = welcome.durability;
  texts[SHEARBUS_ACCESS] = welcome.access;
  return texts;
}

struct ResumedNames {  // what shearbus_resumed_nodes() points to
  std::vector<const char*> pairs, parameters;
  std::vector<const double*> values;
};

ResumedNames names_of(const Session& session) {
  ResumedNames names;
  const ResumedNodes& resumed = session.resumed_nodes();
  if (resumed.pair.empty()) return names;
  names.pairs.push_back("");
  for (const std::string& pair : session.opened().pairs) names.pairs.push_back(pair.c_str());
  for (const std::string& key : session.opened().parameters) names.parameters.push_back(key.c_str());
  for (const std::vector<double>& values : resumed.parameters) names.values.push_back(values.data());
  return names;
}

}  // namespace

// The members are destroyed in reverse order: the session before its client, the client before its server.
struct shearbus_session {
  explicit shearbus_session(const shearbus_options& options)
      : log(options.log, options.log_user, environment("SHEARBUS_LOG")) {
    std::string endpoint = environment("SHEARBUS_ENDPOINT");
    if (endpoint.empty()) endpoint = text_or(options.endpoint);
    if (is_embedded(endpoint))
      embedded.emplace(std::string(text_or(options.state_dir)), options.threads == 0 ? 1 : options.threads);
    else if (options.state_dir != nullptr && environment("SHEARBUS_ENDPOINT").empty())
      refuse(Code::kUnsupported,
             fmt::format("state_dir is set, and the server at {} is another process", in_message(endpoint)),
             "Leave state_dir NULL, or give the directory to shearbus-server --state-dir.", "state_dir");
    if (embedded && !text_or(options.domain).empty())
      refuse(
          Code::kUnsupported,
          fmt::format("the domain \"{}\" is set, and the server runs in this process, where no other process can have "
                      "a session: nodes cannot move to it",
                      in_message(options.domain)),
          "Give the endpoint of a shearbus-server that all processes reach, or no domain.", "domain");
    const ClientOptions defaults;
    ClientOptions to;
    to.endpoint = embedded ? embedded->endpoint() : endpoint;
    to.context = embedded ? embedded->context() : nullptr;
    to.name = text_or(options.name, "libshearbus");
    if (!embedded && options.server_key_file != nullptr)
      reading(options.server_key_file, files::read_public_key, to.server_key);
    std::string secret_key_file = environment("SHEARBUS_SECRET_KEY_FILE");
    if (secret_key_file.empty()) secret_key_file = text_or(options.secret_key_file);
    if (!embedded && !secret_key_file.empty()) reading(secret_key_file.c_str(), files::read_secret_key, to.secret_key);
    to.connect_deadline = seconds(options.connect_deadline_s, defaults.connect_deadline, "connect_deadline_s");
    to.reply_deadline = seconds(options.reply_deadline_s, defaults.reply_deadline, "reply_deadline_s");
    reply_deadline = to.reply_deadline;
    to.retry_after = seconds(options.retry_after_s, defaults.retry_after, "retry_after_s");
    if (log.wanted()) to.log = log;
    if (options.interrupted != nullptr)
      to.interrupted = [ask = options.interrupted, user = options.interrupted_user] { return ask(user) != 0; };
    to.record = environment("SHEARBUS_RECORD");
    to.check_closure = check_of(options.check_closure);
    check = to.check_closure;
    where = embedded ? "in this process" : "at " + endpoint;
    client.emplace(std::move(to));
  }

  // Adopts a session. Where there is no memory for what it tells, it ends as it began: closed, or left on the server.
  void opened(Session&& now, bool resuming) {
    try {
      SessionTexts told = texts_of(*client, now);
      ResumedNames names = names_of(now);
      std::string all = lines(now.warnings());
      session.emplace(std::move(now));
      texts = std::move(told);
      resumed = std::move(names);
      warnings = std::move(all);
    } catch (...) {
      if (resuming) now.leave();
      throw;
    }
    try {
      tell_opening();
    } catch (const std::bad_alloc&) {
      // The session is open, though the lines about it are not written.
    }
  }

  void tell_opening() const {
    if (!log.wanted()) {
      for (const std::string& warning : session->warnings())
        if (!warning.starts_with(wire::kNote)) fmt::print(stderr, "shearbus: warning: {}\n", warning);
      return;
    }
    log(fmt::format("session of {} nodes, scene \"{}\", server {}", session->node_ids().size(),
                    session->opened().scene_name, where));
    for (const std::string& warning : session->warnings()) log(wire::labelled(warning));
  }

  mutable Holder holder;
  LineLog log;
  std::optional<EmbeddedServer> embedded;
  std::optional<Client> client;
  std::optional<Session> session;  // empty while the opening has an unknown outcome
  std::string where;
  std::string warnings;
  SessionTexts texts;
  ResumedNames resumed;
  CheckClosure check = CheckClosure::kWarn;
  std::uint64_t steps = 0;  // number of steps answered so far
  // The present step.
  Batch batch;
  std::vector<Field> batch_fields;  // columns that `batch` was made with
  std::size_t batch_rows = 0;
  std::vector<shearbus_output> outputs;
  std::vector<Field> wanted;  // columns of its answer
  bool started = false;       // true between shearbus_start() and shearbus_finish()
  std::chrono::milliseconds reply_deadline{0};
  std::optional<Fallback> fallback;  // set if the host has a law of its own and the user allows it
};

namespace {

// guarded() for a call on a session, which one thread of the session's process makes at a time.
template <typename Body>
int guarded(const shearbus_session* session, shearbus_status* status, const Body& body) noexcept {
  return guarded(status, [&] {
    const Call call(session == nullptr ? nullptr : &session->holder);
    body();
  });
}

// The session of a handle; refuses a handle without one. The second overload also refuses a handle with an
// unfinished step if `started` is false, and one without an unfinished step if it is true.
const Session& session_of(const shearbus_session* handle) {
  if (handle == nullptr || !handle->session)
    refuse(Code::kInvalidValue, "there is no session: none was opened, or its opening failed", "Open a session first.");
  return *handle->session;
}
void settle_doubt(shearbus_session& handle);
Session& session_of(shearbus_session* handle, bool started = false) {
  session_of(static_cast<const shearbus_session*>(handle));
  settle_doubt(*handle);
  if (handle->started != started)
    refuse(Code::kInvalidValue,
           started ? "a step is finished that was not started" : "a started step has not been finished",
           started ? "Start a step first, and finish it once." : "Finish it before any other call.");
  return *handle->session;
}

std::string column_name(std::uint32_t field, std::uint32_t component) {
  const char* name = shearbus_field_name(field);
  return fmt::format("{}{}", name == nullptr ? fmt::format("column {}", field) : name,
                     component == 0 ? "" : fmt::format(" component {}", component));
}

std::string names_of_columns(std::span<const Field> fields) {
  std::string text;
  for (const Field field : fields) text += fmt::format("{}{}", text.empty() ? "" : ", ", wire::name(field));
  return text.empty() ? "none" : text;
}

bool contains(std::span<const Field> fields, Field field) {
  return std::ranges::find(fields, field) != fields.end();
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
                  fmt::format("Its {}s are: {}; and: {}.", kind, names_of_columns(first), names_of_columns(second)));
  const std::uint32_t components = wire::is_tangential(field) ? session.opened().tangential_components : 1;
  if (component >= components)
    refuse_column(Code::kShape,
                  fmt::format(": the scene gives this column {} component{}", components, components == 1 ? "" : "s"),
                  "Set tangential_components in the scene, or leave the column out.");
  if (values == nullptr) refuse_column(Code::kInvalidValue, ": values is NULL", "Give one value per row.");
  check_stride(number, component, stride_bytes);
}

// The fields of the inputs, each once. Refuses an input field of which a component is missing or given twice.
std::vector<Field> fields_of(const Session& session, std::span<const shearbus_input> inputs, bool with_node_ids) {
  const wire::SessionOpened& opened = session.opened();
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
               "Give every component of a column, once.", wire::name(field));
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
  return handle.check != CheckClosure::kOff && handle.session->opened().strategy == wire::Strategy::kForceDriven &&
         (handle.check == CheckClosure::kError || handle.steps < kStepsWatched);
}

// Prepares the step in the session: its batch with the values of the inputs, the wanted columns, and the outputs.
StepOptions prepare(shearbus_session& handle, const shearbus_request& request) {
  Session& session = *handle.session;
  if (request.mode != SHEARBUS_ADVANCE && request.mode != SHEARBUS_TRIAL)
    refuse(Code::kInvalidValue,
           fmt::format("mode is {}, expected SHEARBUS_ADVANCE (0) or SHEARBUS_TRIAL (1)", request.mode),
           "Set the mode of the step.", "mode");
  const bool some = request.node_ids != nullptr;
  if (!some && request.n != session.node_ids().size())
    refuse(Code::kShape, fmt::format("n is {}, and the session has {} nodes", request.n, session.node_ids().size()),
           "Give one row per node, or name the node of each row in node_ids.", "n");
  const auto inputs = values_of(request.inputs, request.n_inputs, "inputs");
  const auto outputs = values_of(request.outputs, request.n_outputs, "outputs");
  std::vector<Field> fields = fields_of(session, inputs, some);
  std::vector<Field> wanted;
  for (const shearbus_output& output : outputs) {
    check_column(session, output.field, output.component, output.values, output.stride_bytes, "output",
                 session.opened().reply_columns, session.opened().columns_on_request);
    if (!contains(wanted, static_cast<Field>(output.field))) wanted.push_back(static_cast<Field>(output.field));
  }
  if (fields != handle.batch_fields || request.n != handle.batch_rows) {
    handle.batch = Batch::of(fields, request.n, session.opened().tangential_components);
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
  session.want(wanted);
  handle.wanted = std::move(wanted);
  return {.dt_s = request.dt_s,
          .time_s = request.time_s,
          .step = request.step,
          .attempt = request.attempt,
          .commit_previous = request.commit_previous != 0,
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
        .round_trip_ns = static_cast<std::uint64_t>(answer.round_trip().count()),
        .largest_closure_m_per_s = upscale.largest_closure_m_per_s,
        .closure_node = upscale.closure_node,
        .layer_time_s = upscale.layer_time_s,
        .replayed = answer.replayed()},
       result);
}

// ---- the host's own law, while the server is gone ----

void tell(const shearbus_session& handle, const std::string& line) {
  if (line.empty()) return;
  if (handle.log.wanted())
    handle.log(line);
  else
    fmt::print(stderr, "shearbus: {}\n", line);
}

// Completes on the server the step that it may have got before it was gone. Throws if it is still gone.
void settle_doubt(shearbus_session& handle) {
  if (!handle.fallback || !handle.fallback->doubt()) return;
  const StepInDoubt& doubt = *handle.fallback->doubt();
  handle.session->want(doubt.wanted);
  handle.session->advance(doubt.batch, doubt.options);
  handle.fallback->settled();
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
      doubt.emplace(StepInDoubt{std::move(handle.batch), options, handle.wanted});
    if (doubt) handle.batch_fields.clear();  // the batch of the next step is made anew
    return tell(handle, fallback.answer(given, fault.status(), std::move(doubt), result));
  }
  tell(handle, fallback.came_back());
}

void check_result(const shearbus_result* result) {
  if (result != nullptr) known(result, "shearbus_result");
}

std::string name_of(const char* text, const char* what) {
  if (text == nullptr || *text == '\0')
    refuse(Code::kInvalidValue, fmt::format("{} is NULL or empty", what), "Give a text.", what);
  return text;
}

TransferId transfer_of(const std::uint8_t* bytes) {
  if (bytes == nullptr) refuse(Code::kInvalidValue, "transfer is NULL", "Give the 16 bytes of the offer.", "transfer");
  TransferId id;
  std::copy_n(bytes, id.size(), id.begin());
  return id;
}

// Makes the handle of a session, in use by this call, or reuses the handle whose opening has an unknown outcome.
shearbus_session& handle_for(shearbus_session** at, const shearbus_options& options, Call& call) {
  if (*at != nullptr && (*at)->session)
    refuse(Code::kInvalidValue, "this session is open already", "Close it first, or use another handle.");
  if (*at == nullptr) {
    auto made = std::make_unique<shearbus_session>(options);
    call.enter(&made->holder);
    *at = made.release();
  }
  return **at;
}

// Opens or resumes a session by opening(options, call), which gives the handle its session. A handle that got none is freed
// unless the server may have opened the session although the call failed, and `keeps_doubted`: then the same call makes
// the same request.
template <typename Opening>
int open_by(shearbus_session** session, const shearbus_options* options, shearbus_status* status, bool keeps_doubted,
            const Opening& opening) noexcept {
  return guarded(status, [&] {
    if (session == nullptr) refuse(Code::kInvalidValue, "the address of the session is NULL", "Give &session.");
    Call call(*session == nullptr ? nullptr : &(*session)->holder);
    const auto drop_unopened = [&] {
      if (*session == nullptr || (*session)->session) return;
      call.forget();
      delete std::exchange(*session, nullptr);
    };
    try {
      opening(known(options, "shearbus_options"), call);
    } catch (const Error& fault) {
      if (!keeps_doubted || fault.status().code != Code::kUnknownOutcome) drop_unopened();
      throw;
    } catch (const std::bad_alloc&) {
      if (!keeps_doubted) drop_unopened();
      throw;
    } catch (...) {
      drop_unopened();
      throw;
    }
  });
}

}  // namespace

const char* shearbus_version(void) {
  return SHEARBUS_VERSION_TEXT;
}

const char* shearbus_code_name(int code) {
  switch (code) {
    case SHEARBUS_OK:
      return "OK";
    case SHEARBUS_NO_MEMORY:
      return "NO_MEMORY";
    case SHEARBUS_LIBRARY_FAULT:
      return "LIBRARY_FAULT";
    case SHEARBUS_IN_USE:
      return "IN_USE";
    case SHEARBUS_OTHER_PROCESS:
      return "OTHER_PROCESS";
    case SHEARBUS_NO_LIBRARY:
      return "NO_LIBRARY";
    default:
      return code > 1 ? wire::name(static_cast<Code>(code)) : "?";
  }
}

const char* shearbus_field_name(uint32_t field) {
  const wire::ColumnRow* row = wire::find_column(static_cast<Field>(field));
  return row == nullptr ? nullptr : row->name;
}

uint32_t shearbus_field_number(const char* name) {
  for (const wire::ColumnRow& row : wire::column_rows())
    if (name != nullptr && std::strcmp(row.name, name) == 0) return static_cast<std::uint32_t>(row.field);
  return 0;
}

int shearbus_open(shearbus_session** session, const shearbus_options* options, size_t n, const uint64_t* node_ids,
                  const double* initial_temperature_k, shearbus_status* status) {
  shearbus_nodes nodes = SHEARBUS_NODES_INIT;
  nodes.n = n;
  nodes.node_ids = node_ids;
  nodes.initial_temperature_k = initial_temperature_k;
  return shearbus_open_nodes(session, options, &nodes, status);
}

int shearbus_open_nodes(shearbus_session** session, const shearbus_options* options, const shearbus_nodes* nodes,
                        shearbus_status* status) {
  return open_by(session, options, status, true, [&](const shearbus_options& given, Call& call) {
    const shearbus_nodes of = known(nodes, "shearbus_nodes");
    const Scene scene = scene_of(given);
    const auto ids = values_of(of.node_ids, of.n, "node_ids");
    NodeOptions properties = properties_of(of);
    shearbus_session& handle = handle_for(session, given, call);
    handle.opened(handle.client->open(scene.text, scene.name, ids,
                                      {.initial_temperature_k = properties.initial_temperature_k,
                                       .domain = std::string(text_or(given.domain)),
                                       .idle_limit_s = given.idle_limit_s,
                                       .pairs = std::move(properties.pairs),
                                       .pair = properties.pair,
                                       .parameters = std::move(properties.parameters)}),
                  false);
  });
}

int shearbus_resume(shearbus_session** session, const shearbus_options* options, const char* ticket,
                    shearbus_status* status) {
  const shearbus_nodes nodes = SHEARBUS_NODES_INIT;
  return shearbus_resume_nodes(session, options, ticket, &nodes, status);
}

int shearbus_resume_nodes(shearbus_session** session, const shearbus_options* options, const char* ticket,
                          const shearbus_nodes* nodes, shearbus_status* status) {
  return open_by(session, options, status, false, [&](const shearbus_options& given, Call& call) {
    const shearbus_nodes of = known(nodes, "shearbus_nodes");
    const Session::Ticket held = ticket_of(text_or(ticket));
    shearbus_session& handle = handle_for(session, given, call);
    handle.opened(handle.client->resume(
                      held, {.node_ids = values_of(of.node_ids, of.n, "node_ids"), .options = properties_of(of)}),
                  true);
  });
}

// A handle of another process is forgotten, not freed: its sockets and threads are that process's. A handle in use is
// kept, because the other thread needs it.
int shearbus_close(shearbus_session** session, shearbus_status* status) {
  return guarded(status, [&] {
    if (session == nullptr || *session == nullptr) return;
    shearbus_session* const handle = *session;
    if (!handle->holder.is_of_this_process()) *session = nullptr;
    Call call(&handle->holder);
    *session = nullptr;
    call.forget();
    const std::unique_ptr<shearbus_session> owner(handle);
    if (!handle->session) return;
    if (handle->fallback) tell(*handle, handle->fallback->summary());
    if (std::exchange(handle->started, false)) {
      try {
        handle->session->finish_trial();
      } catch (const Error&) {
        // If the step was refused, the session is closed all the same.
      }
    }
    handle->session->close();
  });
}

int shearbus_end(shearbus_session* session, shearbus_totals* totals, shearbus_status* status) {
  return guarded(session, status, [&] {
    Session& open = session_of(session);
    if (totals != nullptr) known(totals, "shearbus_totals");
    if (session->fallback) tell(*session, session->fallback->summary());
    const wire::SessionClosed closed = open.close();
    if (totals != nullptr)
      give({.requests = closed.requests,
            .node_steps = closed.node_steps,
            .solver_ns = closed.solver_ns,
            .asleep_node_steps = closed.asleep_node_steps},
           totals);
  });
}

void shearbus_leave(shearbus_session** session) {
  guarded(nullptr, [&] {
    if (session == nullptr || *session == nullptr) return;
    shearbus_session* const handle = *session;
    if (!handle->holder.is_of_this_process()) *session = nullptr;
    Call call(&handle->holder);
    *session = nullptr;
    call.forget();
    const std::unique_ptr<shearbus_session> owner(handle);
    if (handle->fallback) tell(*handle, handle->fallback->summary());
    if (handle->session) handle->session->leave();
  });
}

int shearbus_ticket(const shearbus_session* session, char ticket[SHEARBUS_TICKET_BYTES], shearbus_status* status) {
  return guarded(session, status, [&] {
    if (ticket == nullptr) refuse(Code::kInvalidValue, "ticket is NULL", "Give SHEARBUS_TICKET_BYTES bytes.", "ticket");
    const Session::Ticket held = session_of(session).ticket();
    char* at = to_hex(held.session_id, ticket);
    *at++ = ':';
    *to_hex(held.resume_token, at) = '\0';
  });
}

int shearbus_resumed_nodes(const shearbus_session* session, shearbus_nodes* nodes, shearbus_status* status) {
  return guarded(session, status, [&] {
    const ResumedNodes& resumed = session_of(session).resumed_nodes();
    known(nodes, "shearbus_nodes");
    const ResumedNames& names = session->resumed;
    give({.n = resumed.node_ids.size(),
          .node_ids = resumed.node_ids.data(),
          .n_pairs = names.pairs.size(),
          .pairs = names.pairs.data(),
          .pair = resumed.pair.data(),
          .n_parameters = names.parameters.size(),
          .parameters = names.parameters.data(),
          .values = names.values.data()},
         nodes);
  });
}

int shearbus_set_reply_deadline(shearbus_session* session, double reply_deadline_s, shearbus_status* status) {
  return guarded(session, status, [&] {
    if (session == nullptr) session_of(session);
    session->reply_deadline = seconds(reply_deadline_s, ClientOptions().reply_deadline, "reply_deadline_s");
    session->client->set_reply_deadline(session->reply_deadline);
  });
}

int shearbus_set_fallback(shearbus_session* session, shearbus_fallback_fn law, void* user, shearbus_status* status) {
  return guarded(session, status, [&] {
    session_of(session);
    session->fallback.reset();
    const auto patience = fallback_patience(environment("SHEARBUS_FALLBACK"));
    if (law != nullptr && patience) session->fallback.emplace(law, user, *patience);
  });
}

int shearbus_count_fallbacks(const shearbus_session* session, shearbus_fallbacks* fallbacks, shearbus_status* status) {
  return guarded(session, status, [&] {
    session_of(session);
    known(fallbacks, "shearbus_fallbacks");
    shearbus_fallbacks totals = SHEARBUS_FALLBACKS_INIT;
    if (session->fallback) totals = session->fallback->totals();
    totals.allowed = session->fallback.has_value();
    give(totals, fallbacks);
  });
}

const char* shearbus_text(const shearbus_session* session, int which) {
  if (session == nullptr || which < 0 || which > SHEARBUS_ACCESS) return "";
  return session->texts[static_cast<std::size_t>(which)].c_str();
}

int shearbus_step(shearbus_session* session, const shearbus_request* request, shearbus_result* result,
                  shearbus_status* status) {
  return guarded(session, status, [&] {
    session_of(static_cast<const shearbus_session*>(session));
    const shearbus_request given = known(request, "shearbus_request");
    check_result(result);
    const auto ask = [&](const StepOptions& options) {
      Session& open = *session->session;
      const auto step = [&]() -> const StepResult& {
        return given.mode == SHEARBUS_TRIAL ? open.trial(session->batch, options)
                                            : open.advance(session->batch, options);
      };
      deliver(*session, with_columns(*session, step), result);
    };
    if (session->fallback && given.mode == SHEARBUS_ADVANCE && !session->started)
      return step_or_fall_back(*session, given, result, ask);
    session_of(session);
    ask(prepare(*session, given));
  });
}

int shearbus_start(shearbus_session* session, const shearbus_request* request, shearbus_status* status) {
  return guarded(session, status, [&] {
    Session& open = session_of(session);
    const shearbus_request given = known(request, "shearbus_request");
    const StepOptions options = prepare(*session, given);
    with_columns(*session, [&] {
      if (given.mode == SHEARBUS_TRIAL)
        open.start_trial(session->batch, options);
      else
        open.start_advance(session->batch, options);
    });
    session->started = true;
  });
}

int shearbus_finish(shearbus_session* session, shearbus_result* result, shearbus_status* status) {
  return guarded(session, status, [&] {
    Session& open = session_of(session, true);
    check_result(result);
    session->started = false;
    deliver(*session, with_columns(*session, [&]() -> const StepResult& { return open.finish_trial(); }), result);
  });
}

int shearbus_commit(shearbus_session* session, shearbus_status* status) {
  return guarded(session, status, [&] { session_of(session).commit(); });
}

int shearbus_rollback(shearbus_session* session, shearbus_status* status) {
  return guarded(session, status, [&] { session_of(session).rollback(); });
}

int shearbus_mark(shearbus_session* session, const char* name, shearbus_status* status) {
  return guarded(session, status, [&] {
    const wire::Marked marked = session_of(session).mark(name_of(name, "name"));
    session->texts[SHEARBUS_MARK_NAMES] = lines(marked.names);
  });
}

int shearbus_rollback_to(shearbus_session* session, const char* name, shearbus_status* status) {
  return guarded(session, status, [&] { session_of(session).rollback_to(name_of(name, "name")); });
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
    const Profiles profiles = session_of(session).profiles(ids, std::span(pressure_pa, pressure_pa == nullptr ? 0 : n));
    *vertices = profiles.vertices;
    if (room < profiles.vertices && n_outputs > 0)
      refuse(Code::kShape,
             fmt::format("a profile has {} vertices, and the arrays have room for {}", profiles.vertices, room),
             "Make the arrays larger, and make the call again.", "vertices");
    for (const shearbus_output& output : wanted) {
      const std::span<const double> values = profiles.of(static_cast<Field>(output.field), output.component);
      const std::ptrdiff_t stride = output.stride_bytes == 0 ? std::ptrdiff_t{sizeof(double)} : output.stride_bytes;
      auto* at = static_cast<char*>(output.values);
      for (std::size_t row = 0; row < profiles.nodes * profiles.vertices; ++row, at += stride) {
        const double value = values.empty() ? std::numeric_limits<double>::quiet_NaN() : values[row];
        std::memcpy(at, &value, sizeof value);
      }
    }
  });
}

int shearbus_register(shearbus_session* session, size_t n, const uint64_t* node_ids,
                      const double* initial_temperature_k, shearbus_status* status) {
  return guarded(session, status, [&] {
    session_of(session).register_nodes(values_of(node_ids, n, "node_ids"),
                                       {initial_temperature_k, initial_temperature_k == nullptr ? 0 : n});
  });
}

int shearbus_register_nodes(shearbus_session* session, const shearbus_nodes* nodes, shearbus_status* status) {
  return guarded(session, status, [&] {
    const shearbus_nodes of = known(nodes, "shearbus_nodes");
    session_of(session).register_nodes(values_of(of.node_ids, of.n, "node_ids"), properties_of(of));
  });
}

int shearbus_retire(shearbus_session* session, size_t n, const uint64_t* node_ids, shearbus_status* status) {
  return guarded(session, status, [&] { session_of(session).retire_nodes(values_of(node_ids, n, "node_ids")); });
}

int shearbus_offer(shearbus_session* session, size_t n, const uint64_t* node_ids,
                   uint8_t transfer[SHEARBUS_TRANSFER_BYTES], shearbus_status* status) {
  return guarded(session, status, [&] {
    transfer_of(transfer);
    const TransferId id = session_of(session).offer_nodes(values_of(node_ids, n, "node_ids"));
    std::ranges::copy(id, transfer);
  });
}

int shearbus_accept(shearbus_session* session, const uint8_t transfer[SHEARBUS_TRANSFER_BYTES],
                    shearbus_status* status) {
  return guarded(session, status, [&] { session_of(session).accept_nodes(transfer_of(transfer)); });
}

size_t shearbus_offers(const shearbus_session* session, size_t capacity,
                       uint8_t (*transfers)[SHEARBUS_TRANSFER_BYTES]) {
  if (session == nullptr || !session->session) return 0;
  const std::vector<TransferId>& offers = session->session->offers();
  for (std::size_t i = 0; transfers != nullptr && i < std::min(capacity, offers.size()); ++i)
    std::ranges::copy(offers[i], transfers[i]);
  return offers.size();
}

size_t shearbus_node_count(const shearbus_session* session) {
  return session == nullptr || !session->session ? 0 : session->session->node_ids().size();
}

const uint64_t* shearbus_node_ids(const shearbus_session* session) {
  return shearbus_node_count(session) == 0 ? nullptr : session->session->node_ids().data();
}

const char* shearbus_effective_scene(const shearbus_session* session) {
  return session == nullptr || !session->session ? "" : session->session->effective_scene().c_str();
}

const char* shearbus_warnings(const shearbus_session* session) {
  return session == nullptr ? "" : session->warnings.c_str();
}

int shearbus_inspect(const shearbus_session* session, shearbus_info* info, shearbus_status* status) {
  return guarded(session, status, [&] {
    const Session& open = session_of(session);
    known(info, "shearbus_info");
    give({.strategy = static_cast<int>(open.opened().strategy),
          .tangential_components = open.opened().tangential_components,
          .bytes_per_node = open.bytes_per_node(),
          .last_sequence = open.last_sequence(),
          .outlives_server = session->client->welcome().durability != "none",
          .state_version = open.state_version(),
          .max_rows_per_message = session->client->welcome().limits.max_rows_per_message,
          .max_marks = session->client->welcome().limits.max_marks},
         info);
  });
}

size_t shearbus_columns(const shearbus_session* session, int use, size_t capacity, uint32_t* fields) {
  if (session == nullptr || !session->session) return 0;
  const wire::SessionOpened& opened = session->session->opened();
  const std::vector<Field>* const lists[] = {&opened.required_columns, &opened.optional_columns, &opened.reply_columns,
                                             &opened.columns_on_request};
  if (use < 0 || use >= static_cast<int>(std::size(lists))) return 0;
  const std::vector<Field>& list = *lists[use];
  for (std::size_t i = 0; fields != nullptr && i < std::min(capacity, list.size()); ++i)
    fields[i] = static_cast<std::uint32_t>(list[i]);
  return list.size();
}
