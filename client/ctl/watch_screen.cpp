#include "client/ctl/watch_screen.hpp"

#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string_view>
#include <utility>

#include "proto/wire/limits.hpp"
#include "proto/wire/text.hpp"

namespace shearbus::ctl {
namespace {

// How the regimes are shown: colours of the 256 of terminals, or letters.
constexpr std::array kColours = {255, 67, 36, 178, 52};
constexpr std::string_view kLetters = ".-CT#";
static_assert(kColours.size() == wire::kRegimeCount && kLetters.size() == wire::kRegimeCount,
              "a colour and a letter each");

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

void write(const std::string& text) {
  static_cast<void>(std::fputs(text.c_str(), stdout));
  static_cast<void>(std::fflush(stdout));
}

}  // namespace

std::string printable(const std::string& text) {
  return wire::printable(text, wire::kMaxTextBytes);
}

Screen::Screen() {
  const char* const no_color = std::getenv("NO_COLOR");
  colours_ = no_color == nullptr || *no_color == '\0';
  enter();
}

bool Screen::is_possible() {
  const char* const term = std::getenv("TERM");
  return ::isatty(STDOUT_FILENO) == 1 && term != nullptr && std::string_view(term) != "dumb" && *term != '\0';
}

void Screen::enter() {
  if (inside_) return;
  if (::tcgetattr(STDIN_FILENO, &before_) == 0) {
    termios quiet = before_;
    quiet.c_lflag &= ~static_cast<tcflag_t>(ECHO | ICANON);
    has_keys_ = ::tcsetattr(STDIN_FILENO, TCSANOW, &quiet) == 0;
  }
  write("\033[?1049h\033[?25l");
  inside_ = true;
}

void Screen::leave() {
  if (!inside_) return;
  write("\033[0m\033[?25h\033[?1049l");
  if (has_keys_) ::tcsetattr(STDIN_FILENO, TCSANOW, &before_);
  has_keys_ = inside_ = false;
}

void Screen::draw(const WatchOptions& options, const Report& report) {
  struct winsize size {};
  if (::ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0 || size.ws_row == 0)
    size = {.ws_row = 24, .ws_col = 80, .ws_xpixel = 0, .ws_ypixel = 0};
  columns_ = size.ws_col;
  lines_.clear();
  add(fmt::format("shearbus-ctl watch (q ends)  every {:g} s  {}  {}", options.interval_s, wire::utc_now(),
                  options.server));
  add("");
  if (report.sample == nullptr) {
    add("NO ANSWER, asked again at each look");
    add(text(report.line, "fault"));
  } else {
    describe(report);
  }
  std::string text = "\033[H";
  for (std::size_t i = 0; i < std::min<std::size_t>(lines_.size(), size.ws_row); ++i)
    text += (i > 0 ? "\r\n" : "") + lines_[i] + "\033[K";
  write(text + "\033[J");
}

void Screen::describe(const Report& report) {
  const Sample& sample = *report.sample;
  const Json& s = sample.status;
  add(fmt::format("server      {}, up {}, {} threads{}", text(s, "server_version"), duration(seconds(s, "uptime_ns")),
                  count(s, "threads"), flag(s, "draining") ? ", DRAINING: no new sessions" : ""));
  add(fmt::format("{:<11} {} with {}, {}B of states", sample.is_operator ? "sessions" : "yours", count(s, "sessions"),
                  wire::counted(count(s, "nodes"), "node"), scaled(s.at("state_bytes").get<double>())));
  add_regimes(s);
  const std::optional<double> busy = number(report, "solver_s_per_s");
  add(fmt::format("rate        {}node-steps/s, {}requests/s; the solver works {} of the time",
                  scaled(number(report, "node_steps_per_s")), scaled(number(report, "requests_per_s")),
                  busy ? fmt::format("{:.0f} %", 100.0 * *busy) : "-"));
  if (!sample.is_operator) return;
  add(fmt::format("steps       half answered within {}, 99 % within {}", duration(number(report, "p50_s")),
                  duration(number(report, "p99_s"))));
  add(sample.is_durable
          ? fmt::format("journal     {}B/s; last checkpoint {}", scaled(number(report, "journal_bytes_per_s")),
                        age_of_checkpoint(s))
          : "journal     none: the server was started without --state-dir, and keeps nothing when it ends");
  for (std::size_t i = 0; i < sample.hottest.size(); ++i) {
    const Json& hot = sample.hottest[i];
    add(fmt::format("{:<11} {:.1f} K  {:<8} node {} of {}", i == 0 ? "hottest" : "",
                    hot.at("interface_temperature_k").get<double>(), text(hot, "regime"), count(hot, "node"),
                    text(hot, "session")));
  }
  if (sample.sessions.empty()) return;
  add("");
  add(fmt::format("{:>9} {:>10}  {}", "nodes", "idle for", "scene and session, opened by"));
  for (const Json& session : sample.sessions)
    add(fmt::format("{:>9} {:>10}  {}, {}", count(session, "nodes"), duration(seconds(session, "idle_ns")),
                    label_of(session), text(session, "identity")));
}

// A bar over the width of the screen with a part for each regime, and below it the regimes by name.
void Screen::add_regimes(const Json& status) {
  constexpr std::size_t kLabel = 12;
  if (status.at("regimes").empty() || columns_ <= kLabel) return;
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
    if (used + text.size() - 1 > columns_) {  // on a line of its own, without the blanks at its end
      lines_.push_back(std::exchange(names, std::string(kLabel, ' ')));
      used = kLabel;
    }
    used += 1 + text.size();
    names += part(r++, 1) + text;
  }
  lines_.push_back(bar);
  lines_.push_back(names);
}

std::string Screen::part(std::size_t regime, std::size_t width) const {
  if (!colours_) return std::string(width, kLetters[regime]);
  return fmt::format("\033[48;5;{}m{}\033[0m", kColours[regime], std::string(width, ' '));
}

void Screen::add(const std::string& text) {
  lines_.push_back(cut(printable(text), columns_));
}

}  // namespace shearbus::ctl
