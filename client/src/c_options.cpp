#include "client/src/c_options.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>

#include "client/src/c_calls.hpp"
#include "proto/files/input_file.hpp"
#include "proto/files/key_file.hpp"
#include "proto/wire/host_process.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/text.hpp"

namespace shearbus {
namespace {

constexpr std::size_t kLongestName = 1024;  // of a file, in a message

static_assert(static_cast<int>(CheckClosure::kWarn) == SHEARBUS_CHECK_WARN);
static_assert(static_cast<int>(CheckClosure::kOff) == SHEARBUS_CHECK_OFF);
static_assert(static_cast<int>(CheckClosure::kError) == SHEARBUS_CHECK_ERROR);
CheckClosure check_of(int option) {
  if (option < SHEARBUS_CHECK_WARN || option > SHEARBUS_CHECK_ERROR)
    refuse(Code::kInvalidValue, fmt::format("check_closure is {}, expected 0 (warn), 1 (off) or 2 (error)", option),
           "Use 'warn', 'off' or 'error' (in C and C++ SHEARBUS_CHECK_WARN, SHEARBUS_CHECK_OFF or "
           "SHEARBUS_CHECK_ERROR).",
           "check_closure");
  return static_cast<CheckClosure>(option);
}

std::string text_of_file(const std::string& path) try {
  std::string text = files::RegularFile(path).head(wire::kMaxSceneBytes + 1);
  if (text.size() > wire::kMaxSceneBytes)
    refuse(Code::kLimit, fmt::format("the scene {} has more than {} bytes", in_message(path), wire::kMaxSceneBytes),
           "Is it a TOML file?", "scene_file");
  return text;
} catch (const Error& fault) {
  if (errno == EMFILE)
    refuse(Code::kUnreachable, fmt::format("the scene {} cannot be read: {}", in_message(path), wire::limit_of_files()),
           {});
  if (fault.status().code != Code::kInvalidValue) throw;
  refuse(Code::kInvalidScene, "the scene " + fault.status().text, "Name a TOML file that this process may read.",
         "scene_file");
}

void reading(const char* file, std::string (*read)(const std::filesystem::path&), const char* field, std::string& key) {
  try {
    key = read(file);
  } catch (const std::runtime_error& fault) {
    refuse(Code::kAuth, fault.what(), "shearbus-ctl keygen makes a pair of key files.", field);
  }
}

}  // namespace

std::string environment(const char* name) {
  return std::string(text_or(::secure_getenv(name)));  // NOLINT(concurrency-mt-unsafe)
}

std::string environment(const shearbus_options& options, const char* name) {
  return options.ignore_environment != 0 ? std::string() : environment(name);
}

std::string in_message(std::string_view text) {
  constexpr std::size_t kLongest = 4096;
  return wire::printable(text, kLongest);
}

bool from_hex(std::string_view digits, std::span<std::uint8_t> bytes) {
  if (digits.size() != 2 * bytes.size()) return false;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    const char* first = digits.data() + 2 * i;
    if (std::from_chars(first, first + 2, bytes[i], 16).ptr != first + 2) return false;
  }
  return true;
}

LineLog::LineLog(shearbus_log_fn function, void* user, std::string file)
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

void LineLog::operator()(const std::string& line) const {
  try {
    if (function_ != nullptr) function_(user_, line.c_str());
  } catch (...) {
    // If the callback of a C++ host throws, the call that wrote the line goes on.
  }
  if (file_ == "stderr") {
    fmt::print(stderr, "shearbus: {}\n", line);
  } else if (!file_.empty()) {
    const std::string text = fmt::format("shearbus: {}\n", line);
    std::FILE* file = std::fopen(file_.c_str(), "ae");
    const bool written = file != nullptr && std::fwrite(text.data(), 1, text.size(), file) == text.size();
    const bool kept = file != nullptr && std::fclose(file) == 0;
    if (!written || !kept)  // a line is never lost without a word
      fmt::print(stderr, "{}shearbus: SHEARBUS_LOG: {} could not be written, and lacks this line\n", text,
                 wire::printable(file_, kLongestName));
  }
}

std::chrono::milliseconds seconds(double value, std::chrono::milliseconds otherwise, const char* name) {
  constexpr double kLongest = 1e7;
  if (value == 0.0) return otherwise;
  if (!(value > 0.0 && value <= kLongest))
    refuse(Code::kInvalidValue,
           fmt::format("{} is {}, expected a time above 0 and at most {} s", name, value, kLongest),
           "Give a time in seconds, or 0 for the default.", name);
  return std::chrono::milliseconds(std::max<long long>(1, std::llround(value * 1e3)));
}

Scene scene_of(const shearbus_options& options) {
  const std::string override_file = environment(options, "SHEARBUS_SCENE");
  const std::string file = override_file.empty() ? std::string(text_or(options.scene_file)) : override_file;
  const bool has_text = options.scene_text != nullptr && override_file.empty();
  if (has_text == !file.empty())
    refuse(Code::kInvalidScene,
           has_text ? "the options have both scene_file and scene_text" : "the options have no scene",
           "Set either scene_file or scene_text.", "scene_file");
  Scene scene = has_text
                    ? Scene{.text = options.scene_text, .name = std::string(text_or(options.scene_name, "scene_text"))}
                    : Scene{.text = text_of_file(file), .name = file};
  if (scene.text.find_first_not_of(" \t\r\n") == std::string::npos)
    refuse(Code::kInvalidScene, fmt::format("{}: the scene is empty", in_message(scene.name)),
           "Begin with client/examples/constant_friction.toml.", "scene_file");
  return scene;
}

bool is_embedded(const std::string& endpoint) {
  return endpoint.empty() || endpoint.substr(0, endpoint.find_last_not_of(' ') + 1) == "embedded";
}

Error naming_variable(Status status, const shearbus_options* options) {
  constexpr std::pair<const char*, const char*> kVariables[] = {{"endpoint", "SHEARBUS_ENDPOINT"},
                                                                {"scene_file", "SHEARBUS_SCENE"},
                                                                {"secret_key_file", "SHEARBUS_SECRET_KEY_FILE"}};
  for (const auto& [field, variable] : kVariables)
    if (status.field == field && !environment(*options, variable).empty())
      status.text += fmt::format("; the {} is that of the environment, {}", field, variable);
  return Error(std::move(status));
}

std::string endpoint_of(const shearbus_options& options) {
  std::string endpoint = environment(options, "SHEARBUS_ENDPOINT");
  if (endpoint.empty()) endpoint = text_or(options.endpoint);
  return endpoint;
}

void embed(const shearbus_options& options, const std::string& endpoint, std::optional<EmbeddedServer>& embedded) {
  if (options.threads > wire::kMaxThreads)
    refuse(Code::kInvalidValue, fmt::format("threads is {}, expected at most {}", options.threads, wire::kMaxThreads),
           "Give the number of cores at most, or 0 for the default.", "threads");
  if (is_embedded(endpoint))
    embedded.emplace(std::string(text_or(options.state_dir)), options.threads == 0 ? 1 : options.threads);
  else if (options.state_dir != nullptr && environment(options, "SHEARBUS_ENDPOINT").empty())
    refuse(Code::kUnsupported,
           fmt::format("state_dir is set, and the server at {} is another process", in_message(endpoint)),
           "Leave state_dir NULL, or give the directory to shearbus-server --state-dir.", "state_dir");
  if (embedded && !text_or(options.domain).empty())
    refuse(Code::kUnsupported,
           fmt::format("the domain \"{}\" is set, and the server runs in this process, where no other process can have "
                       "a session: nodes cannot move to it",
                       in_message(options.domain)),
           "Give the endpoint of a shearbus-server that all processes reach, or no domain.", "domain");
}

ClientOptions client_options(const shearbus_options& options, const std::string& endpoint,
                             const std::optional<EmbeddedServer>& embedded, const LineLog& log) {
  const ClientOptions defaults;
  ClientOptions to;
  to.endpoint = embedded ? embedded->endpoint() : endpoint;
  to.context = embedded ? embedded->context() : nullptr;
  to.name = text_or(options.name, "libshearbus");
  if (!embedded && options.server_key_file != nullptr)
    reading(options.server_key_file, files::read_public_key, "server_key_file", to.server_key);
  std::string secret_key_file = environment(options, "SHEARBUS_SECRET_KEY_FILE");
  if (secret_key_file.empty()) secret_key_file = text_or(options.secret_key_file);
  if (!embedded && !secret_key_file.empty())
    reading(secret_key_file.c_str(), files::read_secret_key, "secret_key_file", to.secret_key);
  to.connect_deadline = seconds(options.connect_deadline_s, defaults.connect_deadline, "connect_deadline_s");
  to.reply_deadline = seconds(options.reply_deadline_s, defaults.reply_deadline, "reply_deadline_s");
  to.retry_after = seconds(options.retry_after_s, defaults.retry_after, "retry_after_s");
  if (log.wanted()) to.log = log;
  if (options.interrupted != nullptr)
    to.interrupted = [ask = options.interrupted, user = options.interrupted_user] { return ask(user) != 0; };
  to.record = environment(options, "SHEARBUS_RECORD");
  to.check_closure = check_of(options.check_closure);
  return to;
}

}  // namespace shearbus
