// The screen of shearbus-ctl watch.
#pragma once

#include <termios.h>

#include <cstddef>
#include <string>
#include <vector>

#include "client/ctl/watch.hpp"
#include "client/ctl/watch_report.hpp"

namespace shearbus::ctl {

// The alternate screen of the terminal, without echo and cursor. leave() restores everything.
class Screen {
 public:
  Screen();
  ~Screen() { leave(); }
  Screen(const Screen&) = delete;
  Screen& operator=(const Screen&) = delete;

  static bool is_possible();

  void enter();
  void leave();
  bool has_keys() const { return has_keys_; }
  void draw(const WatchOptions& options, const Report& report);

 private:
  void describe(const Report& report);
  void add_regimes(const Json& status);
  std::string part(std::size_t regime, std::size_t width) const;
  void add(const std::string& text);

  termios before_{};
  bool inside_ = false;
  bool has_keys_ = false;
  bool colours_ = true;
  std::size_t columns_ = 80;
  std::vector<std::string> lines_;
};

// A text that peers may have written, for a line.
std::string printable(const std::string& text);

}  // namespace shearbus::ctl
