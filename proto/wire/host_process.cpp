#include "proto/wire/host_process.hpp"

#include <fmt/format.h>
#include <pthread.h>
#include <sys/eventfd.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <mutex>
#include <new>
#include <optional>
#include <stdexcept>
#include <system_error>
#include <utility>

#if defined(__x86_64__)
#include <xmmintrin.h>
#endif

namespace shearbus::wire {
namespace {

constexpr std::size_t kThreadsOfContext = 2;  // libzmq's for input and output, and the one that closes sockets
constexpr std::size_t kMemoryOfContext = std::size_t{32} << 20;  // of a context and an opening  [bytes]
constexpr std::size_t kFilesOfContext = 12;  // of a context, its first socket, the monitor of that, and its connection

std::optional<std::uint64_t> limit(__rlimit_resource which) {
  rlimit found{};
  if (::getrlimit(which, &found) != 0 || found.rlim_cur == RLIM_INFINITY) return std::nullopt;
  return found.rlim_cur;
}

std::optional<std::uint64_t> number_in(const std::string& path) {
  std::ifstream file(path);
  file.imbue(std::locale::classic());
  std::uint64_t number = 0;
  if (file >> number) return number;
  return std::nullopt;
}

// The control group of this process, or one that it is in, that has as many threads as it may; empty: none.
std::string full_control_group() {
  std::ifstream groups("/proc/self/cgroup");
  for (std::string line; std::getline(groups, line);) {
    const std::size_t name = line.find(':'), path = line.find(':', name + 1);
    if (path == std::string::npos) continue;
    const std::string controllers = line.substr(name + 1, path - name - 1);
    if (!controllers.empty() && controllers != "pids") continue;
    const std::string root = controllers.empty() ? "/sys/fs/cgroup" : "/sys/fs/cgroup/pids";
    for (std::string group = line.substr(path + 1);; group.resize(group.rfind('/'))) {
      const auto most = number_in(root + group + "/pids.max");
      const auto present = number_in(root + group + "/pids.current");
      if (most && present && *present + kThreadsOfContext > *most)
        return fmt::format("the control group {} may have {} threads (pids.max)", group.empty() ? "/" : group, *most);
      if (group.rfind('/') == std::string::npos) break;
    }
  }
  return {};
}

// The limits that may keep this process from making a thread.
std::string limit_of_threads() {
  if (std::string group = full_control_group(); !group.empty()) return group;
  std::string text;
  if (const auto memory = limit(RLIMIT_AS))
    text =
        fmt::format("the process may use {} MB of memory (ulimit -v), of which the stack of a thread takes {} MB, or ",
                    *memory >> 20, limit(RLIMIT_STACK).value_or(0) >> 20);
  if (const auto most = limit(RLIMIT_NPROC))
    return text + fmt::format("uid {} may have {} processes and threads (ulimit -u)", ::getuid(), *most);
  return text + "the machine has as many threads as it may (kernel.threads-max, kernel.pid_max)";
}

// Why this process gets no memory.
std::string limit_of_memory() {
  const auto most = limit(RLIMIT_AS);
  return most ? fmt::format("the process may use {} MB of memory (ulimit -v)", *most >> 20)
              : "the machine has none to give";
}

struct Threads {
  std::array<std::thread, kThreadsOfContext> threads;
  Threads() = default;
  Threads(const Threads&) = delete;
  Threads& operator=(const Threads&) = delete;
  ~Threads() {
    for (std::thread& thread : threads)
      if (thread.joinable()) thread.join();
  }
};

}  // namespace

// Reading and writing a whole environment takes 1 us. Most hosts have the default one, up to flags, which costs a few
// nanoseconds to find out.
DefaultFloatingPoint::DefaultFloatingPoint() noexcept {
#if defined(__x86_64__)
  constexpr unsigned kFlags = 0x3f, kDefaultControl = 0x1f80;
  constexpr std::uint16_t kDefaultControlOfX87 = 0x037f;
  std::uint16_t control_of_x87 = 0;
  __asm__ volatile("fnstcw %0" : "=m"(control_of_x87));
  control_ = _mm_getcsr();
  changed_ = (control_ & ~kFlags) != kDefaultControl || control_of_x87 != kDefaultControlOfX87;
  if (!changed_) return;
#endif
  std::fegetenv(&before_);
  std::fesetenv(FE_DFL_ENV);
}
DefaultFloatingPoint::~DefaultFloatingPoint() {
#if defined(__x86_64__)
  if (!changed_) {
    _mm_setcsr(control_);
    return;
  }
#endif
  std::fesetenv(&before_);
}

// Kept in a page that the kernel clears in a new process.
pid_t this_process() noexcept {
  static std::atomic<pid_t>* const known = [] {
    const auto size = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
    void* const page = ::mmap(nullptr, size, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (page == MAP_FAILED) return static_cast<std::atomic<pid_t>*>(nullptr);
    if (::madvise(page, size, MADV_WIPEONFORK) == 0) return new (page) std::atomic<pid_t>(0);
    ::munmap(page, size);
    return static_cast<std::atomic<pid_t>*>(nullptr);
  }();
  if (known == nullptr) return ::getpid();
  pid_t process = known->load(std::memory_order_relaxed);
  if (process == 0) known->store(process = ::getpid(), std::memory_order_relaxed);
  return process;
}

SignalsBlocked::SignalsBlocked() noexcept {
  sigset_t all;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before_);
}
SignalsBlocked::~SignalsBlocked() {
  pthread_sigmask(SIG_SETMASK, &before_, nullptr);
}

std::thread own_thread(std::function<void()> run) {
  const SignalsBlocked blocked;
  try {
    return std::thread([run = std::move(run)] {
      std::fesetenv(FE_DFL_ENV);
      run();
    });
  } catch (const std::system_error& fault) {
    throw std::system_error(fault.code(), "no thread can be made: " + limit_of_threads());
  }
}

std::string limit_of_files() {
  return fmt::format("the process may have {} files open (ulimit -n)", limit(RLIMIT_NOFILE).value_or(0));
}

void check_room_for_sockets() {
  std::array<Descriptor, kFilesOfContext> files;  // opened to find out whether they can be
  for (Descriptor& file : files)
    if ((file = Descriptor(::eventfd(0, EFD_CLOEXEC))) < 0)
      throw std::runtime_error(errno == EMFILE
                                   ? "no file can be opened: " + limit_of_files()
                                   : fmt::format("no file can be opened: {}", std::system_category().message(errno)));
  // All of the threads at once, so they wait for each other.
  std::mutex gate;
  Threads threads;
  const std::lock_guard closed(gate);
  for (std::thread& thread : threads.threads) thread = own_thread([&gate] { const std::lock_guard passing(gate); });
  // While their stacks are in memory, too.
  void* const memory =
      ::mmap(nullptr, kMemoryOfContext, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (memory == MAP_FAILED)
    throw std::runtime_error(
        fmt::format("{} MB of memory are not to be had: {}", kMemoryOfContext >> 20, limit_of_memory()));
  ::munmap(memory, kMemoryOfContext);
}

Event::Event(const char* fault) : file_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  if (file_ < 0) throw std::runtime_error(fault + (": " + limit_of_files()));
}

void Event::set() const noexcept {
  const std::uint64_t one = 1;
  static_cast<void>(::write(file_, &one, sizeof one) < 0);  // a counter that is full is set already
}

void Event::clear() const noexcept {
  std::uint64_t calls = 0;
  static_cast<void>(::read(file_, &calls, sizeof calls) < 0);
}

bool is_served(std::string_view path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.size() >= sizeof address.sun_path) return false;  // too long for a socket
  std::memcpy(address.sun_path, path.data(), path.size());
  const Descriptor probe(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  return ::connect(probe, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0 || errno == EAGAIN;
}

}  // namespace shearbus::wire
