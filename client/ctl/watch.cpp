#include "client/ctl/watch.hpp"

#include <fmt/format.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/signalfd.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

#include "client/ctl/operations.hpp"
#include "proto/wire/enum_names.hpp"
#include "proto/wire/limits.hpp"
#include "proto/wire/text.hpp"

namespace shearbus::ctl {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kHottest = 3;
constexpr std::size_t kSessionsAsked = 8;  // sessions whose hottest nodes are asked for: those with the most nodes

// How the regimes are shown: colours of the 256 of terminals, or letters.
constexpr std::array kColours = {255, 67, 36, 178, 52};
constexpr std::string_view kLetters = ".-CT#";
static_assert(kColours.size() == wire::kRegimeCount && kLetters.size() == wire::kRegimeCount, "a colour and a letter each");

struct HotNode {
  std::string session;  // name of its scene, and the first digits of its id
  std::uint64_t node = 0;
  double temperature_k = 0.0;
  std::size_t regime = 0;
};

// The answers of a server to one look.
struct Sample : Told {
  std::vector<wire::SessionInfo> sessions = {};  // those with the most nodes first; only an operator sees them
  std::vector<HotNode> hottest = {};
};

// What is shown of a look: the state, and the rates since the look before.
struct Report {
  const Sample* sample = nullptr;  // null: no answer
  std::string fault;               // why there is no answer
  std::optional<double> node_steps_per_s, requests_per_s, journal_bytes_per_s, solver_share;
  std::optional<double> half_below_s, most_below_s;  // of the steps since the look before: 50 % and 99 % took less
};

std::string label_of(const wire::SessionInfo& session) {
  return session.name + ' ' + wire::hexadecimal(std::span(session.session_id).first(4));
}

// Asks for the sessions and the hottest nodes, for which the server looks at every node.
void inspect(Operator& server, Sample& sample) {
  sample.sessions = server.sessions();
  std::ranges::stable_sort(sample.sessions, std::greater<>(), &wire::SessionInfo::nodes);
  for (std::size_t i = 0; i < std::min(kSessionsAsked, sample.sessions.size()); ++i) {
    const wire::SessionInfo& session = sample.sessions[i];
    try {
      const TopNodes top = server.top_nodes(session.session_id, wire::Top::kHottest, kHottest);
      for (std::size_t n = 0; n < top.node_ids.size(); ++n)
        sample.hottest.push_back({label_of(session), top.node_ids[n], top.interface_temperature_k[n], top.regime[n]});
    } catch (const Error& fault) {
      if (fault.status().code != Code::kUnknownSession) throw;  // closed meanwhile
    }
  }
  std::ranges::stable_sort(sample.hottest, std::greater<>(), &HotNode::temperature_k);
  if (sample.hottest.size() > kHottest) sample.hottest.resize(kHottest);
}

const wire::Histogram* steps_of(const wire::ServerStatus& status) {
  for (const wire::Histogram& histogram : status.histograms)
    if (histogram.name == "request" && histogram.verb == "downscale") return &histogram;
  return nullptr;
}

Report report_of(const Sample& now, const std::optional<Sample>& before) {
  Report report{.sample = &now, .fault = {}};
  if (!before || now.status.uptime_ns <= before->status.uptime_ns) return report;  // another server
  const wire::ServerStatus &a = before->status, &b = now.status;
  const double elapsed_s = seconds(b.uptime_ns - a.uptime_ns);
  const auto rate = [&](std::uint64_t from, std::uint64_t to) {
    return to < from ? 0.0 : static_cast<double>(to - from) / elapsed_s;
  };
  report.node_steps_per_s = rate(a.node_steps, b.node_steps);
  report.requests_per_s = rate(a.requests, b.requests);
  report.solver_share = 1e-9 * rate(a.solver_ns, b.solver_ns);
  if (!now.is_operator) return report;
  report.journal_bytes_per_s = rate(a.journal_bytes, b.journal_bytes);
  if (const wire::Histogram* const steps = steps_of(b)) {
    std::vector<std::uint64_t> counts = steps->counts;
    if (const wire::Histogram* const earlier = steps_of(a))
      for (std::size_t i = 0; i < std::min(counts.size(), earlier->counts.size()); ++i)
        counts[i] -= std::min(counts[i], earlier->counts[i]);
    report.half_below_s = quantile(counts, 0.5);
    report.most_below_s = quantile(counts, 0.99);
  }
  return report;
}

// ---- Texts ----

std::string scaled(double value) {
  constexpr std::array<const char*, 5> kPrefixes = {"", "k", "M", "G", "T"};
  std::size_t prefix = 0;
  while (value >= 999.5 && prefix + 1 < kPrefixes.size()) {
    value /= 1000;
    ++prefix;
  }
  return fmt::format("{:.3g} {}", value, kPrefixes[prefix]);
}
std::string scaled(const std::optional<double>& value) {
  return value ? scaled(*value) : std::string("- ");
}
std::uint64_t nodes_in_regimes(const wire::ServerStatus& status) {
  std::uint64_t all = 0;
  for (const std::uint64_t count : status.regimes) all += count;
  return all;
}

double percent(std::uint64_t part, std::uint64_t all) {
  return all == 0 ? 0.0 : 100.0 * static_cast<double>(part) / static_cast<double>(all);
}

std::string age_of_checkpoint(const wire::ServerStatus& status) {
  return status.checkpoint_age_ns != 0 ? duration(seconds(status.checkpoint_age_ns)) + " ago" : "none yet";
}

std::string line_of(const Report& report) {
  if (report.sample == nullptr) return fmt::format("{} no answer: {}", wire::utc_now(), report.fault);
  const wire::ServerStatus& s = report.sample->status;
  std::string text =
      fmt::format("{} {}, {}:", wire::utc_now(), counted(s.sessions, "session"), counted(s.nodes, "node"));
  for (const auto& [regime, nodes] : regimes_of(s))
    text += fmt::format(" {} {:.1f}%", regime, percent(nodes, nodes_in_regimes(s)));
  text += fmt::format("; {}node-steps/s", scaled(report.node_steps_per_s));
  if (report.sample->is_operator)
    text += fmt::format(", p50 {}, p99 {}", duration(report.half_below_s), duration(report.most_below_s));
  if (report.sample->is_operator && report.sample->is_durable)
    text += fmt::format("; journal {}B/s, checkpoint {}", scaled(report.journal_bytes_per_s), age_of_checkpoint(s));
  for (const HotNode& hot : report.sample->hottest)
    text += fmt::format("{} {:.1f} K", &hot == report.sample->hottest.data() ? "; hottest" : ",", hot.temperature_k);
  return text;
}

std::string json_of(const Report& report) {
  nlohmann::ordered_json line = {{"time", wire::utc_now()}, {"answers", report.sample != nullptr}};
  if (report.sample == nullptr) {
    line["fault"] = report.fault;
    return line.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
  }
  const auto number = [](const std::optional<double>& value) {
    return value ? nlohmann::ordered_json(*value) : nlohmann::ordered_json();
  };
  const wire::ServerStatus& s = report.sample->status;
  line.update({{"server_version", s.server_version},
               {"uptime_s", seconds(s.uptime_ns)},
               {"draining", s.draining},
               {"sessions", s.sessions},
               {"nodes", s.nodes},
               {"state_bytes", s.state_bytes}});
  for (const auto& [regime, nodes] : regimes_of(s)) line["regimes"][regime] = nodes;
  line.update({{"node_steps_per_s", number(report.node_steps_per_s)},
               {"requests_per_s", number(report.requests_per_s)},
               {"solver_s_per_s", number(report.solver_share)}});
  if (report.sample->is_operator) {
    line.update({{"p50_s", number(report.half_below_s)},
                 {"p99_s", number(report.most_below_s)},
                 {"journal_bytes_per_s", number(report.journal_bytes_per_s)},
                 {"checkpoint_age_s", s.checkpoint_age_ns != 0 ? nlohmann::ordered_json(seconds(s.checkpoint_age_ns))
                                                               : nlohmann::ordered_json()}});
    line["hottest"] = nlohmann::ordered_json::array();
    for (const HotNode& hot : report.sample->hottest)
      line["hottest"].push_back({{"session", hot.session},
                                 {"node", hot.node},
                                 {"interface_temperature_k", hot.temperature_k},
                                 {"regime", wire::regime_name(hot.regime)}});
  }
  return line.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

// ---- The screen ----

// Names come from peers.
std::string printable(const std::string& text) {
  return wire::printable(text, wire::kMaxTextBytes);
}

// Cuts a text without escape codes to a number of columns, each character being one column wide.
std::string cut(const std::string& text, std::size_t columns) {
  std::size_t end = 0, width = 0;
  while (end < text.size() && width < columns) {
    ++end;
    while (end < text.size() && (static_cast<unsigned char>(text[end]) & 0xc0) == 0x80) ++end;
    ++width;
  }
  return text.substr(0, end);
}

// The alternate screen of the terminal, without echo and cursor. leave() restores everything.
class Screen {
 public:
  Screen() {
    const char* const no_color = std::getenv("NO_COLOR");
    colours_ = no_color == nullptr || *no_color == '\0';
    enter();
  }
  ~Screen() { leave(); }
  Screen(const Screen&) = delete;
  Screen& operator=(const Screen&) = delete;

  static bool is_possible() {
    const char* const term = std::getenv("TERM");
    return ::isatty(STDOUT_FILENO) == 1 && term != nullptr && std::string_view(term) != "dumb" && *term != '\0';
  }

  void enter() {
    if (inside_) return;
    if (::tcgetattr(STDIN_FILENO, &before_) == 0) {
      termios quiet = before_;
      quiet.c_lflag &= ~static_cast<tcflag_t>(ECHO | ICANON);
      has_keys_ = ::tcsetattr(STDIN_FILENO, TCSANOW, &quiet) == 0;
    }
    write("\033[?1049h\033[?25l");
    inside_ = true;
  }
  void leave() {
    if (!inside_) return;
    write("\033[0m\033[?25h\033[?1049l");
    if (has_keys_) ::tcsetattr(STDIN_FILENO, TCSANOW, &before_);
    has_keys_ = inside_ = false;
  }
  bool has_keys() const { return has_keys_; }

  void draw(const WatchOptions& options, const Report& report) {
    struct winsize size {};
    if (::ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0 || size.ws_row == 0)
      size = {.ws_row = 24, .ws_col = 80, .ws_xpixel = 0, .ws_ypixel = 0};
    columns_ = size.ws_col;
    lines_.clear();
    add(fmt::format("shearbus-ctl watch  {}  {}  every {:g} s; q ends", options.server, wire::utc_now(),
                    options.interval_s));
    add("");
    if (report.sample == nullptr) {
      add("NO ANSWER, asked again at each look");
      add(report.fault);
    } else {
      describe(report);
    }
    std::string text = "\033[H";
    for (std::size_t i = 0; i < std::min<std::size_t>(lines_.size(), size.ws_row); ++i)
      text += (i > 0 ? "\r\n" : "") + lines_[i] + "\033[K";
    write(text + "\033[J");
  }

 private:
  void describe(const Report& report) {
    const Sample& sample = *report.sample;
    const wire::ServerStatus& s = sample.status;
    add(fmt::format("server      {}, up {}, {} threads{}", s.server_version, duration(seconds(s.uptime_ns)), s.threads,
                    s.draining ? ", DRAINING: no new sessions" : ""));
    add(fmt::format("{:<11} {} with {}, {}B of states", sample.is_operator ? "sessions" : "yours", s.sessions,
                    counted(s.nodes, "node"), scaled(static_cast<double>(s.state_bytes))));
    add_regimes(s);
    add(fmt::format("rate        {}node-steps/s, {}requests/s; the solver works {} of the time",
                    scaled(report.node_steps_per_s), scaled(report.requests_per_s),
                    report.solver_share ? fmt::format("{:.0f} %", 100.0 * *report.solver_share) : "-"));
    if (!sample.is_operator) return;
    add(fmt::format("steps       half answered within {}, 99 % within {}", duration(report.half_below_s),
                    duration(report.most_below_s)));
    add(sample.is_durable
            ? fmt::format("journal     {}B/s; last checkpoint {}", scaled(report.journal_bytes_per_s),
                          age_of_checkpoint(s))
            : "journal     none: the server was started without --state-dir, and keeps nothing when it ends");
    for (std::size_t i = 0; i < sample.hottest.size(); ++i) {
      const HotNode& hot = sample.hottest[i];
      add(fmt::format("{:<11} {:.1f} K  {:<8} node {} of {}", i == 0 ? "hottest" : "", hot.temperature_k,
                      wire::regime_name(hot.regime), hot.node, hot.session));
    }
    if (sample.sessions.empty()) return;
    add("");
    add(fmt::format("{:>9} {:>10}  {}", "nodes", "idle for", "scene and session, opened by"));
    for (const wire::SessionInfo& session : sample.sessions)
      add(fmt::format("{:>9} {:>10}  {}, {}", session.nodes, duration(seconds(session.idle_ns)), label_of(session),
                      session.identity));
  }

  // A bar over the width of the screen with a part for each regime, and below it the regimes by name.
  void add_regimes(const wire::ServerStatus& status) {
    constexpr std::size_t kLabel = 12;
    if (status.regimes.empty() || columns_ <= kLabel) return;
    const std::size_t width = std::min<std::size_t>(columns_ - kLabel, 60);
    const std::uint64_t all = nodes_in_regimes(status);
    if (all == 0) return add("regimes     no nodes");
    const auto column = [&](std::uint64_t nodes) {
      return static_cast<std::size_t>(
          std::lround(static_cast<double>(width) * static_cast<double>(nodes) / static_cast<double>(all)));
    };
    std::string bar = "regimes     ", names(kLabel, ' ');
    std::uint64_t before = 0;
    std::size_t used = kLabel, r = 0;
    for (const auto& [regime, nodes] : regimes_of(status)) {
      bar += part(r, column(before + nodes) - column(before));
      before += nodes;
      const std::string text = fmt::format(" {} {:.1f} %  ", regime, percent(nodes, all));
      used += 1 + text.size();
      if (used <= columns_) names += part(r, 1) + text;
      ++r;
    }
    lines_.push_back(bar);
    lines_.push_back(names);
  }

  std::string part(std::size_t regime, std::size_t width) const {
    if (!colours_) return std::string(width, kLetters[regime]);
    return fmt::format("\033[48;5;{}m{}\033[0m", kColours[regime], std::string(width, ' '));
  }

  void add(const std::string& text) { lines_.push_back(cut(printable(text), columns_)); }

  static void write(const std::string& text) {
    static_cast<void>(std::fputs(text.c_str(), stdout));
    static_cast<void>(std::fflush(stdout));
  }

  termios before_{};
  bool inside_ = false;
  bool has_keys_ = false;
  bool colours_ = true;
  std::size_t columns_ = 80;
  std::vector<std::string> lines_;
};

// ---- Signals ----

// The signals that watch() reads from a descriptor. They are blocked while the object exists.
class Signals {
 public:
  Signals() {
    sigemptyset(&set_);
    for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGTSTP, SIGWINCH}) sigaddset(&set_, signal);
    pthread_sigmask(SIG_BLOCK, &set_, &before_);
    file_ = ::signalfd(-1, &set_, SFD_CLOEXEC | SFD_NONBLOCK);
  }
  ~Signals() {
    ::close(file_);
    pthread_sigmask(SIG_SETMASK, &before_, nullptr);
  }
  Signals(const Signals&) = delete;
  Signals& operator=(const Signals&) = delete;

  int file() const { return file_; }
  int next() const {  // 0: none
    signalfd_siginfo info{};
    return ::read(file_, &info, sizeof info) == sizeof info ? static_cast<int>(info.ssi_signo) : 0;
  }
  // Stops the process as SIGTSTP does, and returns when it continues.
  static void stop() {
    sigset_t one;
    sigemptyset(&one);
    sigaddset(&one, SIGTSTP);
    static_cast<void>(::raise(SIGTSTP));
    pthread_sigmask(SIG_UNBLOCK, &one, nullptr);  // here it takes effect
    pthread_sigmask(SIG_BLOCK, &one, nullptr);
  }

 private:
  sigset_t set_{};
  sigset_t before_{};
  int file_ = -1;
};

class Watch {
 public:
  Watch(const WatchOptions& options, const std::function<Operator()>& connect) : options_(options), connect_(connect) {
    if (!options.json && Screen::is_possible()) screen_.emplace();
  }

  // Returns whether the server answered the last look.
  bool run() {
    for (std::uint64_t n = 1;; ++n) {
      const Clock::time_point next = Clock::now() + std::chrono::duration_cast<Clock::duration>(
                                                        std::chrono::duration<double>(options_.interval_s));
      ask();
      show();
      if (n == options_.looks || !rest_until(next)) return sample_.has_value();
    }
  }

 private:
  void ask() {
    std::optional<Sample> before = std::exchange(sample_, std::nullopt);
    try {
      if (!server_) server_.emplace(connect_());
      Sample now{told_by(*server_)};
      if (now.is_operator) inspect_now_and_then(now, before);
      sample_ = std::move(now);
      report_ = report_of(*sample_, before);
    } catch (const Error& fault) {
      server_.reset();
      report_ = {.sample = nullptr, .fault = describe(fault.status())};
    }
  }

  // Sessions and hottest nodes are asked for so rarely that the server spends at most kInspecting of its time on them.
  void inspect_now_and_then(Sample& now, const std::optional<Sample>& before) {
    constexpr double kInspecting = 0.02;
    const Clock::time_point begun = Clock::now();
    if (before && begun < next_inspection_) {
      now.sessions = before->sessions;
      now.hottest = before->hottest;
      return;
    }
    inspect(*server_, now);
    const Clock::time_point ended = Clock::now();
    next_inspection_ = ended + std::chrono::duration_cast<Clock::duration>((ended - begun) / kInspecting);
  }

  void show() {
    if (screen_) return screen_->draw(options_, report_);
    fmt::print("{}\n", options_.json ? json_of(report_) : printable(line_of(report_)));
    static_cast<void>(std::fflush(stdout));
  }

  // Returns false if the watch ends.
  bool rest_until(Clock::time_point next) {
    for (;;) {
      for (int signal = signals_.next(); signal != 0; signal = signals_.next())
        if (!handle(signal)) return false;
      const auto left = std::chrono::ceil<std::chrono::milliseconds>(next - Clock::now()).count();
      if (left <= 0) return true;
      std::array<pollfd, 2> files = {{{signals_.file(), POLLIN, 0}, {STDIN_FILENO, POLLIN, 0}}};
      const bool keys = screen_ && screen_->has_keys();
      if (::poll(files.data(), keys ? 2 : 1, static_cast<int>(std::min<std::int64_t>(left, 3'600'000))) <= 0) continue;
      char key = 0;
      if (keys && files[1].revents != 0 && (::read(STDIN_FILENO, &key, 1) <= 0 || key == 'q')) return false;
    }
  }

  // Returns false if the signal ends the watch.
  bool handle(int signal) {
    if (signal == SIGTSTP) {
      if (screen_) screen_->leave();
      Signals::stop();
      if (screen_) screen_->enter();
    } else if (signal != SIGWINCH) {
      return false;
    }
    if (screen_) screen_->draw(options_, report_);
    return true;
  }

  const WatchOptions& options_;
  const std::function<Operator()>& connect_;
  Signals signals_;
  std::optional<Screen> screen_;
  std::optional<Operator> server_;
  std::optional<Sample> sample_;
  Report report_;
  Clock::time_point next_inspection_;
};

}  // namespace

bool watch(const WatchOptions& options, const std::function<Operator()>& connect) {
  return Watch(options, connect).run();
}

}  // namespace shearbus::ctl
