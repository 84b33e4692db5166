#include "proto/files/whole_file.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/random.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <ctime>
#include <system_error>
#include <utility>

#include "proto/files/input_file.hpp"
#include "proto/wire/status.hpp"

namespace shearbus::files {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kPartial = ".partial";
constexpr std::size_t kWordDigits = 6;  // of the random part of a partial file's name
constexpr std::time_t kStaleAfterS = 60;
constexpr const char* kLockName = ".lock";

fs::path directory_of(const fs::path& file) {
  const fs::path directory = file.parent_path();
  return directory.empty() ? fs::path(".") : directory;
}

// Nothing: there is no such file.
std::optional<struct stat> status_of(const fs::path& file) {
  struct stat found {};
  return ::lstat(file.c_str(), &found) == 0 ? std::optional(found) : std::nullopt;
}

bool same_version(const std::optional<struct stat>& a, const std::optional<struct stat>& b) {
  if (!a || !b) return a.has_value() == b.has_value();
  return a->st_dev == b->st_dev && a->st_ino == b->st_ino && a->st_size == b->st_size &&
         a->st_mtim.tv_sec == b->st_mtim.tv_sec && a->st_mtim.tv_nsec == b->st_mtim.tv_nsec;
}

std::string random_word() {
  std::uint32_t bits = 0;
  if (::getrandom(&bits, sizeof bits, 0) != sizeof bits) bits = static_cast<std::uint32_t>(::getpid());
  return fmt::format("{:06x}", bits & 0xffffff);
}

// Whether somebody other than this user and root can make files in a directory.
bool others_write_to(const fs::path& directory) {
  struct stat found {};
  if (::stat(directory.c_str(), &found) != 0) return false;
  return (found.st_uid != ::geteuid() && found.st_uid != 0) || (found.st_mode & (S_IWGRP | S_IWOTH)) != 0;
}

void sync_to_disk(const fs::path& path, const fs::path& named) {
  const wire::Descriptor descriptor(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (descriptor < 0 || ::fsync(descriptor) != 0) refuse_to_write(named, errno);
}

bool is_partial_of(const std::string& name, const std::string& file) {
  if (name.size() != file.size() + 1 + kWordDigits + kPartial.size() || !name.starts_with(file + ".")) return false;
  const std::string_view word = std::string_view(name).substr(file.size() + 1, kWordDigits);
  return name.ends_with(kPartial) &&
         std::ranges::all_of(word, [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); });
}

bool is_summary(const fs::path& file) {
  const std::string text = head_of(file, std::size_t{1} << 20);
  return text.starts_with('{') &&
         (text.find("\"provenance\"") != std::string::npos || text.find("\"producer\"") != std::string::npos);
}

bool is_table(const fs::path& file) {
  const std::string text = head_of(file, 256);
  return text.starts_with("time [s],dt [s],node_id") || text.starts_with("time [s]\tdt [s]\tnode_id");
}

bool is_hdf5(const fs::path& file) {
  return head_of(file, 8) == "\x89HDF\r\n\x1a\n";
}

}  // namespace

const FileKind kSummaryFile = {"a summary (JSON) of shearbus", is_summary};
const FileKind kTableFile = {"a table (CSV) that shearbus wrote", is_table};
const FileKind kHdf5File = {"an HDF5 file", is_hdf5};

void refuse_file(const fs::path& file, const std::string& what, const std::string& remedy, const std::string& dataset) {
  throw wire::Error({.code = wire::Code::kInvalidValue,
                     .text = fmt::format("{}: {}", file.string(), what),
                     .remedy = remedy,
                     .field = dataset});
}

void refuse_to_write(const fs::path& file, int fault) {
  const bool no_space = fault == ENOSPC || fault == EDQUOT || fault == EFBIG;
  throw wire::Error(
      {.code = no_space ? wire::Code::kNoSpace : wire::Code::kInvalidValue,
       .text = file.string() + ": cannot be written: " + std::generic_category().message(fault) + "; no file is left",
       .remedy = no_space                                              ? "Make room there, or write elsewhere."
                 : fault == EACCES || fault == EPERM || fault == EROFS ? "Write into a directory of your own."
                                                                       : "Write elsewhere."});
}

void refuse_inputs_as_output(const std::string& option, const fs::path& out, std::span<const InputFile> inputs) {
  struct stat written {};
  if (out.empty() || ::stat(out.c_str(), &written) != 0) return;
  for (const InputFile& input : inputs) {
    struct stat read {};
    if (input.path.empty() || ::stat(input.path.c_str(), &read) != 0) continue;
    if (written.st_dev == read.st_dev && written.st_ino == read.st_ino)
      throw wire::Error({.code = wire::Code::kInvalidValue,
                         .text = fmt::format("{} {} is {} itself{}", option, out.string(), input.what,
                                             out == input.path ? "" : ", " + input.path.string()),
                         .remedy = "Name another file."});
  }
}

std::string head_of(const fs::path& file, std::size_t most) try {
  return RegularFile(file).head(most);
} catch (const wire::Error&) {
  return {};
}

fs::path target_of_output(const fs::path& file) {
  constexpr int kMostLinks = 40;
  fs::path at = file;
  for (int links = 0; links < kMostLinks; ++links) {
    struct stat found {};
    if (::lstat(at.c_str(), &found) != 0 || !S_ISLNK(found.st_mode)) return at;
    if (found.st_uid != ::geteuid() && others_write_to(directory_of(at)))
      refuse_file(file,
                  fmt::format("is a symbolic link of user {} in a directory that others can write to", found.st_uid),
                  "Remove the link, or write into a directory of your own.");
    std::error_code fault;
    const fs::path to = fs::read_symlink(at, fault);
    if (fault) refuse_to_write(file, fault.value());
    at = to.is_absolute() ? to : at.parent_path() / to;
  }
  refuse_to_write(file, ELOOP);
}

void check_output(const fs::path& named, const FileKind& kind) {
  const fs::path file = target_of_output(named);
  const fs::path directory = directory_of(file);
  struct stat around {
  }, found{};
  if (::stat(directory.c_str(), &around) != 0 || !S_ISDIR(around.st_mode))
    refuse_file(named, fmt::format("there is no directory {}", directory.string()), "Create it, or write elsewhere.");
  if (::lstat(file.c_str(), &found) != 0) return;
  if (S_ISDIR(found.st_mode)) refuse_file(file, "is a directory; expected the name of a file", "Name a file in it.");
  if (!S_ISREG(found.st_mode))
    refuse_file(file, "is no regular file; expected one, or a new name", "Name another file.");
  if (found.st_uid != ::geteuid() && (around.st_mode & S_IWOTH) != 0)
    refuse_file(file, fmt::format("belongs to user {}, in a directory to which everybody can write", found.st_uid),
                "Write into a directory of your own.");
  if (found.st_size == 0 || kind.recognises(file)) return;
  refuse_file(file,
              ::access(file.c_str(), R_OK) == 0
                  ? fmt::format("is there and is not {}; no other file is replaced", kind.name)
                  : "is there and cannot be read to see what it is; it is not replaced",
              "Remove or rename it, or write elsewhere.");
}

PartialFile::PartialFile(const fs::path& file, const FileKind& kind, Writers writers, mode_t mode)
    : file_(target_of_output(file)), writers_(writers) {
  check_output(file, kind);
  if (writers == Writers::kOne) refuse_another_writer();
  before_ = status_of(file_);
  make(mode);
}

// Refuses if another run has a locked partial file, and removes those that killed runs have left.
void PartialFile::refuse_another_writer() const {
  const std::string name = file_.filename().string();
  std::error_code ignored;
  for (const fs::directory_entry& entry : fs::directory_iterator(directory_of(file_), ignored)) {
    if (!is_partial_of(entry.path().filename().string(), name)) continue;
    const wire::Descriptor other(::open(entry.path().c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
    if (other < 0) continue;
    const bool free = ::flock(other, LOCK_SH | LOCK_NB) == 0;
    const bool held = !free && errno == EWOULDBLOCK;
    struct stat found {};
    // Between a file's making and its locking there is a moment.
    const bool stale = free && ::fstat(other, &found) == 0 && S_ISREG(found.st_mode) && found.st_uid == ::geteuid() &&
                       found.st_mtim.tv_sec < std::time(nullptr) - kStaleAfterS;
    if (stale) ::unlink(entry.path().c_str());
    if (held)
      refuse_file(file_, fmt::format("another run writes here, into {}", entry.path().filename().string()),
                  "Wait for it, or give each run an output of its own.");
  }
}

void PartialFile::make(mode_t mode) {
  constexpr int kMostNames = 100;
  for (int tried = 0; tried < kMostNames; ++tried) {
    partial_ = fmt::format("{}.{}{}", file_.string(), random_word(), kPartial);
    descriptor_ = wire::Descriptor(::open(partial_.c_str(), O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, mode));
    if (descriptor_ >= 0) {
      static_cast<void>(
          ::flock(descriptor_, LOCK_EX | LOCK_NB));  // a file system without locks has the check at the end
      return;
    }
    if (errno != EEXIST) break;
  }
  refuse_to_write(file_, errno);
}

PartialFile::~PartialFile() {
  if (descriptor_ >= 0) ::unlink(partial_.c_str());
}

// Keeps the result under a name that is its own.
void PartialFile::refuse_newer() {
  const fs::path kept =
      directory_of(file_) / fmt::format("{}.{}{}", file_.stem().string(), random_word(), file_.extension().string());
  const bool renamed = ::renameat2(AT_FDCWD, partial_.c_str(), AT_FDCWD, kept.c_str(), RENAME_NOREPLACE) == 0;
  if (renamed) descriptor_.close();
  refuse_file(file_,
              fmt::format("another run has written this file since this one began{}",
                          renamed ? "; the result of this one is " + kept.string() : ""),
              "Give each run an output of its own.");
}

void PartialFile::publish() {
  publish_locked();
}

wire::Descriptor PartialFile::publish_locked() {
  if (::fsync(descriptor_) != 0) refuse_to_write(file_, errno);
  if (writers_ == Writers::kOne && !same_version(status_of(file_), before_)) refuse_newer();
  const bool first = writers_ == Writers::kOne && !before_;
  int renamed = ::renameat2(AT_FDCWD, partial_.c_str(), AT_FDCWD, file_.c_str(), first ? RENAME_NOREPLACE : 0);
  if (renamed != 0 && first && errno == EEXIST) refuse_newer();
  if (renamed != 0 && (errno == EINVAL || errno == ENOSYS)) renamed = ::rename(partial_.c_str(), file_.c_str());
  if (renamed != 0) refuse_to_write(file_, errno);
  wire::Descriptor published = std::move(descriptor_);
  sync_to_disk(directory_of(file_), file_);
  return published;
}

wire::Descriptor write_whole_locked(const fs::path& file, const FileKind& kind, std::string_view text) {
  PartialFile partial(file, kind, PartialFile::Writers::kAny);
  while (!text.empty()) {
    const ssize_t written = ::write(partial.descriptor(), text.data(), text.size());
    if (written < 0 && errno != EINTR) refuse_to_write(file, errno);
    if (written > 0) text.remove_prefix(static_cast<std::size_t>(written));
  }
  return partial.publish_locked();
}

void write_whole(const fs::path& file, const FileKind& kind, std::string_view text) {
  write_whole_locked(file, kind, text);
}

OneWriter::OneWriter(const fs::path& directory) : lock_(directory / kLockName) {
  std::error_code fault;
  fs::create_directories(directory, fault);
  if (fault)
    refuse_file(directory, fmt::format("the directory cannot be made: {}", fault.message()), "Write elsewhere.");
  for (;;) {
    descriptor_ = wire::Descriptor(::open(lock_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0666));
    const int first_fault = errno;
    if (descriptor_ < 0 && first_fault == EACCES)  // of another user, in a directory that both write to
      descriptor_ = wire::Descriptor(::open(lock_.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW));
    if (descriptor_ < 0) refuse_to_write(lock_, first_fault);
    if (::flock(descriptor_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)
      refuse_file(directory, "another run writes here", "Wait for it, or give each run a directory of its own.");
    // The run that held the lock before may have removed the file since.
    struct stat held {
    }, named{};
    if (::fstat(descriptor_, &held) == 0 && ::lstat(lock_.c_str(), &named) == 0 && held.st_ino == named.st_ino &&
        held.st_dev == named.st_dev)
      return;
  }
}

OneWriter::~OneWriter() {
  ::unlink(lock_.c_str());
}

}  // namespace shearbus::files
