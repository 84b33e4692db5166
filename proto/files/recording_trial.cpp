#include "proto/files/recording_trial.hpp"

#include <fcntl.h>
#include <hdf5.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <csignal>
#include <vector>

#include "proto/files/hdf5.hpp"
#include "proto/wire/handle.hpp"
#include "proto/wire/host_process.hpp"

namespace shearbus::files::hdf5 {
namespace {

using namespace shearbus::hdf5;  // NOLINT(google-build-using-namespace)

constexpr unsigned kLongestTrial = 300;        // s
constexpr rlim_t kMostProcessorTime = 5;       // s; damage may also make HDF5 go in circles
constexpr std::size_t kMostTexts = 1'000'000;  // of a dataset; those of more nodes are read without a trial

// At the end of a process HDF5 tries to close what damaged metadata made it leak, in vain, and prints "infinite loop
// closing library". The programs close their files themselves.
[[maybe_unused]] const herr_t kNoExitHandler = H5dont_atexit();

// Reads the texts of an attribute or of a dataset, if they are of variable length.
void read_texts(hid_t from) try {
  if (H5Tis_variable_str(type_of(from)) > 0 && count_of(from) <= kMostTexts) texts_of(from);
} catch (const Error&) {  // found by the reader of the file
}

void read_texts_of(hid_t object) {
  const auto read = [](hid_t of, const char* name, const H5A_info_t*, void*) -> herr_t {
    read_texts(Attribute(H5Aopen(of, name, H5P_DEFAULT)));
    return 0;
  };
  hsize_t first = 0;
  H5Aiterate2(object, H5_INDEX_NAME, H5_ITER_NATIVE, &first, read, nullptr);
  if (H5Iget_type(object) != H5I_DATASET) return;
  const Properties creation(H5Dget_create_plist(object));  // values in other files are not read
  if (H5Pget_layout(creation) != H5D_VIRTUAL && H5Pget_external_count(creation) == 0) read_texts(object);
}

void read_texts_in(const char* file) {
  const Quiet quiet;
  const File opened(H5Fopen(file, H5F_ACC_RDONLY, H5P_DEFAULT));
  if (opened < 0) return;
  const auto visit = [](hid_t root, const char* name, const H5O_info_t*, void*) -> herr_t {
    read_texts_of(Object(H5Oopen(root, name, H5P_DEFAULT)));
    return 0;
  };
  H5Ovisit(opened, H5_INDEX_NAME, H5_ITER_NATIVE, visit, nullptr);
}

// What the child does. It says that it has come to the end.
[[noreturn]] void try_it(const char* file, int says) {
  for (const int fault : {SIGSEGV, SIGBUS, SIGABRT, SIGFPE, SIGILL, SIGALRM, SIGXCPU})
    static_cast<void>(std::signal(fault, SIG_DFL));
  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
  const struct rlimit no_core {};
  setrlimit(RLIMIT_CORE, &no_core);
  const struct rlimit processor { kMostProcessorTime, kMostProcessorTime };
  setrlimit(RLIMIT_CPU, &processor);
  if (const int nowhere = ::open("/dev/null", O_WRONLY); nowhere >= 0) ::dup2(nowhere, STDERR_FILENO);
  alarm(kLongestTrial);
  read_texts_in(file);
  const char done = 1;
  _exit(::write(says, &done, 1) == 1 ? 0 : 1);
}

}  // namespace

bool survives_its_texts(const std::filesystem::path& file) {
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0) return true;
  const wire::Descriptor hears(ends[0]);
  wire::Descriptor says(ends[1]);
  const std::string name = file.string();
  const pid_t child = ::fork();
  if (child == 0) try_it(name.c_str(), says);
  says.close();
  char done = 0;
  const bool survived = child < 0 || wire::uninterrupted([&] { return ::read(hears, &done, 1); }) == 1;
  if (child > 0) wire::uninterrupted([&] { return ::waitpid(child, nullptr, 0); });
  return survived;
}

}  // namespace shearbus::files::hdf5
