// Runs build/bin/shearbus-server as a separate process.
#pragma once

#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "shearbus_places.hpp"
#include "tests/support/running_server.hpp"

namespace shearbus::support {

class Process {
 public:
  explicit Process(std::vector<std::string> command, const std::string& output_file) {
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, 1, output_file.c_str(), O_CREAT | O_WRONLY | O_APPEND, 0600);
    posix_spawn_file_actions_adddup2(&actions, 1, 2);
    std::vector<char*> argv;
    for (std::string& word : command) argv.push_back(word.data());
    argv.push_back(nullptr);
    if (::posix_spawn(&pid_, argv[0], &actions, nullptr, argv.data(), environ) != 0)
      throw std::runtime_error("cannot start " + command[0]);
    posix_spawn_file_actions_destroy(&actions);
  }
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;
  ~Process() {
    if (!exit_code(std::chrono::milliseconds(0))) {
      signal(SIGKILL);
      exit_code(std::chrono::seconds(10));
    }
  }

  pid_t id() const { return pid_; }
  void signal(int number) const { ::kill(pid_, number); }

  // Returns the exit code of the process (128 + n for signal n), or nothing if the process still runs after `time`.
  std::optional<int> exit_code(std::chrono::milliseconds time) {
    const auto end = std::chrono::steady_clock::now() + time;
    while (!exit_code_) {
      int status = 0;
      if (::waitpid(pid_, &status, WNOHANG) == pid_)
        exit_code_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
      else if (std::chrono::steady_clock::now() >= end)
        return std::nullopt;
      else
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return exit_code_;
  }

 private:
  pid_t pid_ = 0;
  std::optional<int> exit_code_;
};

inline std::string text_of(const std::filesystem::path& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

class ServerProcess {
 public:
  // `launcher` is a command that starts the server, such as "/usr/bin/env NAME=VALUE"; the server's command line is
  // appended to it.
  explicit ServerProcess(std::vector<std::string> arguments, const std::vector<std::string>& launcher = {})
      : log_(scratch_.path() / "log"),
        endpoints_(std::max<std::ptrdiff_t>(1, std::ranges::count(arguments, "--bind"))) {
    arguments.insert(arguments.begin(), SHEARBUS_BINARY_DIR "/bin/shearbus-server");
    arguments.insert(arguments.begin(), launcher.begin(), launcher.end());
    process_.emplace(std::move(arguments), log_.string());
  }
  // Returns true once the server listens on all its endpoints, or false if it ends before or does not within `time`.
  bool ready(std::chrono::milliseconds time = std::chrono::seconds(20)) {
    const auto end = std::chrono::steady_clock::now() + time;
    while (std::chrono::steady_clock::now() < end && !process_->exit_code(std::chrono::milliseconds(0))) {
      if (listening() >= endpoints_) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return false;
  }
  // Returns the server's TCP endpoint with the port that the kernel has chosen, or an empty text if there is none.
  std::string tcp_endpoint() const {
    const std::string text = log();
    const std::string line = "listening on tcp://";
    const std::size_t at = text.find(line);
    if (at == std::string::npos) return "";
    const std::size_t begin = at + line.size() - std::string("tcp://").size();
    return text.substr(begin, text.find('\n', begin) - begin);
  }
  std::string log() const { return text_of(log_); }
  Process& process() { return *process_; }

 private:
  std::ptrdiff_t listening() const {
    std::istringstream lines(log());
    std::ptrdiff_t count = 0;
    for (std::string line; std::getline(lines, line) && !lines.eof();)  // an incomplete last line is not read
      if (line.find("listening on ") != std::string::npos) ++count;
    return count;
  }

  ScratchDirectory scratch_;
  std::filesystem::path log_;
  std::ptrdiff_t endpoints_;
  std::optional<Process> process_;
};

}  // namespace shearbus::support
