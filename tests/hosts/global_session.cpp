// A C++ host with a session among its globals: global_session SCENE.toml ENDPOINT [LOCALE]. A fork ends by exit(), which
// destroys its copy of the session; then the parent goes on. With LOCALE, the global locale of the C++ library, it prints
// what the library says instead. The exit code is the number of faults.
#include <sys/wait.h>
#include <unistd.h>
#include <shearbus/client.hpp>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <locale>
#include <optional>
#include <sstream>

namespace {

std::optional<shearbus::Session> bus;  // NOLINT(cert-err58-cpp)

int fail(const char* what) {
  std::fprintf(stderr, "not so: %s\n", what);
  return 1;
}

int exit_code_of(pid_t child) {
  for (int i = 0; i < 60'000; ++i) {
    int code = 0;
    if (waitpid(child, &code, WNOHANG) == child) return WIFEXITED(code) ? WEXITSTATUS(code) : -1;
    usleep(1000);
  }
  kill(child, SIGKILL);
  waitpid(child, nullptr, 0);
  return -2;
}

// The texts of an opening, and of one that is refused for a number in the scene.
int print_texts(shearbus::Options options, const char* locale) {
  std::ifstream file(options.scene_file);
  const std::string scene((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  try {
    std::locale::global(std::locale(locale));
  } catch (const std::runtime_error&) {
    return 77;
  }
  shearbus::Session session(options, {1234567});
  std::printf("%s\n%s\n", session.effective_scene().c_str(), session.warnings().c_str());
  session.close();
  options.scene_file.clear();
  options.scene_text = scene + "heat_partition = 1234567.5\n[soft.constants]\ndensity_kg_per_m3 = -1234567.5\n";
  try {
    shearbus::Session(options, {1});
  } catch (const shearbus::Error& refusal) {
    std::printf("%s\n", refusal.what());
    return 0;
  }
  return fail("the scene is refused");
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) return 2;
  shearbus::Options options;
  options.scene_file = argv[1];
  options.endpoint = argv[2];
  if (argc > 3) return print_texts(options, argv[3]);
  const shearbus::Ids ids = {1};
  bus.emplace(options, ids);
  const pid_t child = fork();
  if (child == 0) {
    try {
      bus->commit();
    } catch (const shearbus::Error& refusal) {
      std::exit(refusal.code() == SHEARBUS_OTHER_PROCESS ? 0 : 1);
    }
    std::exit(1);
  }
  if (exit_code_of(child) != 0) return fail("the fork ends by itself, with exit code 0");
  try {
    bus->mark("the parent goes on");
    bus->close();
    bus->close();
  } catch (const shearbus::Error& fault) {
    return fail(fault.what());
  }
  return 0;
}
