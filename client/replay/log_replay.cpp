#include "client/replay/log_replay.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <utility>
#include <variant>

#include "client/replay/compare.hpp"
#include "client/replay/log.hpp"
#include "client/replay/log_export.hpp"
#include "client/replay/result_file.hpp"
#include "client/replay/tally.hpp"
#include "client/src/client.hpp"
#include "client/src/connection.hpp"
#include "client/src/input_check.hpp"
#include "client/src/session.hpp"
#include "proto/files/recording.hpp"
#include "proto/files/session_recorder.hpp"
#include "proto/files/whole_file.hpp"
#include "proto/program/interrupt.hpp"
#include "proto/program/program.hpp"
#include "proto/scene/changed.hpp"
#include "proto/scene/reader.hpp"
#include "proto/wire/codec.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/text.hpp"
#include "server/explain.hpp"
#include "server/in_process.hpp"

namespace shearbus::replay {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

void complain(const std::string& line) {
  program::complain("shearbus-replay: " + line);
}

// Answers requests: a server, or a service in this process.
class Peer {
 public:
  Peer() = default;
  Peer(const Peer&) = delete;
  Peer& operator=(const Peer&) = delete;
  virtual ~Peer() = default;
  virtual const wire::Reply& ask(wire::Request& request) = 0;  // a refusal is a reply, too; valid until the next call
  virtual void change_scene(const wire::SessionId&, const std::string&) {
    throw Error({.code = Code::kUnsupported,
                 .text = "--from-mark changes the scene of a session, which no server does",
                 .remedy = "Leave --server out."});
  }
};

class ServerPeer final : public Peer {
 public:
  ServerPeer(const files::ServerAddress& server, const fs::path& record)
      : connection_(std::make_shared<SocketConnection>(ClientOptions{.endpoint = server.endpoint,
                                                                     .server_key = server.server_key,
                                                                     .secret_key = server.secret_key,
                                                                     .name = "shearbus-replay",
                                                                     .log = complain,
                                                                     .record = record.string()})) {
    const Client greeting(connection_);  // waits connect_deadline for a server; a request would wait reply_deadline
  }

  const wire::Reply& ask(wire::Request& request) override {
    request.request_id = connection_->next_request_id();
    try {
      received_ = connection_->call(request, connection_->options().reply_deadline);
    } catch (const Error& fault) {
      if (static_cast<int>(fault.status().code) / 100 == 5) throw;
      received_ = {};
      received_.reply.status = fault.status();
    }
    return received_.reply;
  }

 private:
  std::shared_ptr<SocketConnection> connection_;
  Received received_;
};

class InProcessPeer final : public Peer {
 public:
  explicit InProcessPeer(const fs::path& record) {
    if (!record.empty())
      recorder_.emplace(files::RecorderOptions{.place = record,
                                               .recorder = files::Recorder::kClient,
                                               .sessions = {},
                                               .log = [](const std::string& line, bool) { complain(line); }});
  }

  const wire::Reply& ask(wire::Request& request) override {
    request.request_id = ++request_id_;
    const std::string header = wire::encode_header(request);
    const bool has_payload = !request.batch.columns().empty();
    answer_ = service_.answer(std::as_bytes(std::span(header)),
                              has_payload ? std::optional(request.batch.bytes()) : std::nullopt);
    const std::span<const std::byte> reply_header = std::as_bytes(std::span(answer_.header));
    const std::array frames = {reply_header, answer_.payload};
    wire::decode(std::span(frames).first(wire::declares_payload(reply_header) ? 2 : 1), reply_);
    if (recorder_)
      recorder_->add({.request_header = std::as_bytes(std::span(header)),
                      .request_payload = request.batch.bytes(),
                      .reply_header = reply_header,
                      .reply_payload = answer_.payload});
    return reply_;
  }
  void change_scene(const wire::SessionId& session, const std::string& scene) override {
    service_.change_scene(session, scene, "the changed scene");
  }

 private:
  server::InProcess service_;
  std::optional<files::SessionRecorder> recorder_;
  server::InProcess::Answer answer_;
  wire::Reply reply_;
  std::uint64_t request_id_ = 0;
};

std::vector<fs::path> logs_below(const std::vector<fs::path>& places) {
  std::vector<fs::path> logs;
  for (const fs::path& place : places) {
    if (!fs::is_directory(place)) {
      logs.push_back(place);
      continue;
    }
    for (const auto& entry : fs::directory_iterator(place))
      if (entry.is_regular_file() && files::is_event_log(entry.path())) logs.push_back(entry.path());
  }
  std::ranges::sort(logs);
  if (logs.empty())
    throw Error({.code = Code::kInvalidValue,
                 .text = fmt::format("{}: expected event logs in the directory, found none", places.front().string()),
                 .remedy = "Name a history, an event log, or the directory that --record of a server names."});
  return logs;
}

// One recorded session, and the session that repeats it.
struct Replayed {
  explicit Replayed(const fs::path& file) : log(file), more(log.next()) {}
  Log log;
  bool more;  // whether `log` has an exchange that has not been replayed
  wire::SessionId id{};
  std::uint64_t sequence = 0;  // of the next request
  NodeOrder order;
  std::uint64_t steps = 0;
  std::string scene;                    // text with which the session was opened again
  std::vector<std::string> parameters;  // keys of which its nodes may have values of their own
  InputCheck inputs;
};

class LogReplay {
 public:
  explicit LogReplay(const Options& options) : options_(options) {}

  bool run() {
    const std::vector<fs::path> files = logs_below(options_.inputs);
    if (!options_.from_mark.empty() && files.size() > 1)
      throw Error({.code = Code::kUnsupported,
                   .text = fmt::format("--from-mark takes one event log; there are {}", files.size())});
    changed_ = !options_.scene.empty() || !options_.set.empty();
    if (options_.from_mark.empty()) {
      branched_ = true;
    } else {
      check_branch();
      branch_at_ = last_mark(files.front());
    }
    const fs::path record = prepare_out(files);
    if (options_.server.endpoint.empty())
      peer_ = std::make_unique<InProcessPeer>(record);
    else
      peer_ = std::make_unique<ServerPeer>(options_.server, record);
    std::vector<std::unique_ptr<Replayed>> sessions;
    sessions.reserve(files.size());
    for (const fs::path& file : files) sessions.push_back(std::make_unique<Replayed>(file));
    const auto start = Clock::now();
    program::stop_at_next_step();
    while (Replayed* next = earliest(sessions)) {
      if (program::interrupted()) throw std::runtime_error(fmt::format("interrupted after {} requests", exchanges_));
      replay(*next);
      if (difference_) break;
      next->more = next->log.next();
    }
    for (const auto& session : sessions) warn(*session, session->inputs.end());
    const double seconds = std::chrono::duration<double>(Clock::now() - start).count();
    peer_.reset();  // closes the recording
    if (!difference_ && !record.empty()) finish_out(record);
    summarise(sessions, seconds);
    return !difference_;
  }

 private:
  static Replayed* earliest(const std::vector<std::unique_ptr<Replayed>>& sessions) {
    Replayed* first = nullptr;
    for (const auto& session : sessions)
      if (session->more && (first == nullptr || session->log.time_ns() < first->log.time_ns())) first = session.get();
    return first;
  }

  void check_branch() const {
    if (!options_.scene.empty())
      throw Error({.code = Code::kUnsupported,
                   .text = "--from-mark goes with --set, not with --scene: the layers keep their states"});
    for (const std::string& change : options_.set)
      if (!change.starts_with("interface."))
        throw Error({.code = Code::kUnsupported,
                     .text = fmt::format("--set {}: from a mark on, only keys of [interface] may change", change),
                     .remedy = "The layers keep their states, which belong to their material and grid; leave "
                               "--from-mark out to change those from the start."});
  }

  // The record in which the mark is set for the last time.
  std::uint64_t last_mark(const fs::path& file) const {
    std::optional<std::uint64_t> found;
    std::vector<std::string> names;
    for (Log log(file); log.next();) {
      const auto* mark = std::get_if<wire::Mark>(&log.request().body);
      if (mark == nullptr || !log.reply().status.ok()) continue;
      names.push_back(mark->name);
      if (mark->name == options_.from_mark) found = log.index();
    }
    if (!found)
      throw Error({.code = Code::kUnknownMark,
                   .text = fmt::format("{} has no mark \"{}\"; it has {}", file.string(), options_.from_mark,
                                       names.empty() ? "none" : fmt::format("{}", fmt::join(names, ", ")))});
    return *found;
  }

  // Checks --out, and returns the place of the event log that the replay writes; empty: none.
  fs::path prepare_out(const std::vector<fs::path>& files) {
    const std::size_t logs = files.size();
    if (options_.out.empty()) return {};
    std::vector<files::InputFile> inputs = {{"the scene", options_.scene}};
    for (const fs::path& file : files) inputs.push_back({"the log", file});
    files::refuse_inputs_as_output("--out", options_.out, inputs);
    if (is_table(options_.out)) {
      if (logs > 1)
        throw Error({.code = Code::kUnsupported,
                     .text = fmt::format("--out {} is one table, and there are {} logs", options_.out.string(), logs),
                     .remedy = "Name a directory, and export its logs one by one."});
      table_.emplace(options_.out, is_text_result(options_.out) ? files::kTableFile : files::kHistoryFile,
                     files::PartialFile::Writers::kOne);
      fs::path log = table_->path();
      log.replace_extension(".log.partial");
      return log;
    }
    if (!options_.from_mark.empty())
      throw Error({.code = Code::kUnsupported,
                   .text = "--out of a branch is a table, .h5 or .csv: an event log has one scene"});
    if (fs::exists(options_.out))
      throw Error({.code = Code::kInvalidValue,
                   .text = fmt::format("--out {} exists; event logs are not replaced", options_.out.string())});
    return logs > 1 ? options_.out / "" : options_.out;
  }

  static bool is_table(const fs::path& out) { return out.extension() == ".h5" || is_text_result(out); }

  void finish_out(const fs::path& record) {
    try {
      std::uint64_t recorded = 0;
      for (const fs::path& file : logs_below({record}))
        for (files::EventLogReader reader(file); reader.next();) ++recorded;
      if (recorded != exchanges_)
        throw Error({.code = Code::kNoSpace,
                     .text = fmt::format("--out {}: {} of {} requests could be recorded", options_.out.string(),
                                         recorded, exchanges_)});
      if (!is_table(options_.out)) return;
      export_log({.log = record,
                  .out = table_->path(),
                  .node = {},
                  .after_mark = options_.from_mark.empty() ? std::nullopt : std::optional(options_.from_mark),
                  .changes = fmt::format("{}", fmt::join(options_.set, ", ")),
                  .final_name = options_.out});
      table_->publish();
    } catch (...) {
      if (is_table(options_.out)) fs::remove(record);
      throw;
    }
    fs::remove(record);
  }

  // Ids of transfers in this replay, which differ from those of the recorded run and of other replays.
  wire::TransferId transfer(wire::TransferId id) const {
    for (std::size_t i = 0; i < id.size(); ++i) id[i] ^= salt_[i];
    return id;
  }

  // `file`: the recorded name of the scene's file.
  std::string scene_of(std::string text, const std::string& file) {
    if (!branched_) return text;
    if (!options_.scene.empty()) text = scene::load_text(options_.scene);
    changed_scene_ = scene::ChangedScene(text, options_.scene.empty() ? file : options_.scene.string(), options_.set,
                                         options_.swept);
    for (const std::string& kept : changed_scene_.kept_by_pairs()) complain("note: " + kept);
    return changed_scene_.text();
  }

  // Of nodes with values of their own in a request that registers them.
  void refuse_own(Replayed& session) const {
    const wire::Request& request = session.log.request();
    if (const auto* open = std::get_if<wire::OpenSession>(&request.body)) session.parameters = open->parameters;
    std::vector<std::string> own;
    for (std::uint32_t key = 0; key < session.parameters.size(); ++key)
      if (!request.batch.f64(Field::kParameter, key).empty()) own.push_back(session.parameters[key]);
    refuse_changes_of_own(options_.set, own);
  }

  void replay(Replayed& session) {
    const Log& log = session.log;
    wire::Request request;
    refuse_own(session);
    request.body = log.request().body;
    request.batch = wire::Batch::over(log.request().batch.columns(), log.request().batch.bytes());
    request.sequence = session.sequence;
    if (auto* open = std::get_if<wire::OpenSession>(&request.body)) {
      session.scene = open->scene;
      open->scene = scene_of(open->scene, open->scene_file);
      session.id = open->session_id = random_bytes();
      open->resume_token = {};
      open->idle_limit_s = 0;
      if (!open->domain.empty()) open->domain = domain(open->domain);
      if (!options_.scene.empty()) open->scene_file = options_.scene.string();
    } else {
      request.session_id = session.id;
      if (auto* offer = std::get_if<wire::OfferNodes>(&request.body)) offer->transfer_id = transfer(offer->transfer_id);
      if (auto* accept = std::get_if<wire::AcceptNodes>(&request.body))
        accept->transfer_id = transfer(accept->transfer_id);
    }
    const wire::Reply& reply = peer_->ask(request);
    const std::string place = place_of(log.request(), session.steps);
    if (const auto* step = std::get_if<wire::Upscale>(&reply.body)) {
      node_steps_ += step->nodes;
      solver_ns_ += step->solver_ns;
    }
    if (!changed_ || !branched_) {
      static const Names kNames = {.a = "the recording", .b = "the replay"};
      const auto what =
          replay::difference(log.reply(), reply, session.order.rows_of(log.request()), kNames, options_.rtol);
      if (what) difference_ = fmt::format("{}, {}: {}", log.name(), place, *what);
    } else if (log.reply().status.ok() && !reply.status.ok()) {
      Status status = changed_scene_.placed(reply.status);
      status.text = fmt::format("{}, {}: {}", log.name(), place, status.text);
      throw Error(status);
    }
    if (const auto* step = std::get_if<wire::Downscale>(&request.body); step != nullptr && reply.status.ok()) {
      warn(session, session.inputs.add(request.batch, step->dt_s, session.order.ids()));
      ranges_.add(request.batch, step->dt_s);
    }
    if (reply.status.ok()) ++session.sequence;
    session.order.follow(log.request(), log.reply());
    if (std::holds_alternative<wire::Downscale>(log.request().body)) ++session.steps;
    ++exchanges_;
    if (!branched_ && log.index() == branch_at_) branch(session);
  }

  static void warn(const Replayed& session, const std::vector<std::string>& warnings) {
    for (const std::string& warning : warnings) complain(fmt::format("warning: {}: {}", session.log.name(), warning));
  }

  void branch(const Replayed& session) {
    branched_ = true;
    if (!changed_) return;
    try {
      peer_->change_scene(session.id, scene_of(session.scene, {}));
    } catch (const std::invalid_argument& fault) {
      throw Error(
          {.code = Code::kOtherScene,
           .text = fmt::format("--from-mark: the changed scene has layers with other states: {}", fault.what())});
    }
  }

  std::string domain(const std::string& recorded) {
    std::string& name = domains_[recorded];
    if (name.empty()) name = "replay " + wire::hexadecimal(random_bytes());
    return name;
  }

  void summarise(const std::vector<std::unique_ptr<Replayed>>& sessions, double seconds) const {
    std::uint64_t left_out = 0;
    std::uint64_t steps = 0;
    for (const auto& session : sessions) {
      left_out += session->log.left_out();
      steps += session->steps;
      if (session->log.torn())
        fmt::print("  note                        {} ends in an incomplete record, which is left out\n",
                   program::shown(session->log.name()));
    }
    const double solver = 1e-9 * static_cast<double>(solver_ns_);
    fmt::print("  sessions                    {}\n", sessions.size());
    fmt::print("  requests                    {}, {} of them steps, {} node-steps\n", exchanges_, steps, node_steps_);
    if (ranges_.dt.lowest <= ranges_.dt.highest) fmt::print("{}", ranges_.text());
    if (left_out > 0)
      fmt::print("  not repeated                {} refusals that the server or the network explain\n", left_out);
    fmt::print("  run time                    {:.3f} s, solver {:.3f} s\n", seconds, solver);
    if (difference_)
      fmt::print("  answers                     DIFFER: {}\n", wire::printable(*difference_, wire::kMaxTextBytes));
    else if (!changed_)
      fmt::print("  answers                     equal to the recorded ones{}\n",
                 options_.rtol > 0 ? fmt::format(" within {}", options_.rtol) : ", to the last bit");
    if (!options_.out.empty() && !difference_)
      fmt::print("  result                      {}\n", program::shown(options_.out));
  }

  const Options& options_;
  std::unique_ptr<Peer> peer_;
  std::optional<files::PartialFile> table_;  // of --out, unless that is an event log
  scene::ChangedScene changed_scene_;
  bool changed_ = false;   // whether another scene is replayed
  bool branched_ = false;  // whether the changes hold for what is replayed now
  std::uint64_t branch_at_ = 0;
  std::array<std::uint8_t, 16> salt_ = random_bytes();
  std::map<std::string, std::string> domains_;
  std::optional<std::string> difference_;
  InputRanges ranges_;
  std::uint64_t exchanges_ = 0, node_steps_ = 0, solver_ns_ = 0;
};

}  // namespace

bool holds_event_logs(const fs::path& path) {
  std::error_code ignored;
  return fs::is_directory(path, ignored) || files::is_event_log(path);
}

void check_sweep_of_logs(const Options& options, std::span<const std::string> changes) {
  if (!options.server.endpoint.empty()) return;
  for (const fs::path& file : logs_below(options.inputs)) {
    const Log log(file);
    const bool other = !options.scene.empty();
    const std::string text = other ? scene::load_text(options.scene) : log.head().scene;
    const std::string name = other ? options.scene.string() : log.name();
    for (const std::string& change : changes) {
      std::vector<std::string> set = options.set;
      set.push_back(change);
      const scene::ChangedScene changed(text, name, set, true);
      try {
        server::check_scene(changed.text(), name);
      } catch (const Error& fault) {
        throw Error(changed.placed(fault.status()));
      }
    }
  }
}

bool replay_logs(const Options& options) {
  return LogReplay(options).run();
}

}  // namespace shearbus::replay
