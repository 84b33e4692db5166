// Files that get their name only when they are complete and on the disk. An output is never one of the inputs and
// replaces only an older file of its own kind.
#pragma once

#include <sys/stat.h>

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "proto/wire/handle.hpp"

namespace shearbus::files {

// Throws Error about a file, or about a dataset in it.
[[noreturn]] void refuse_file(const std::filesystem::path& file, const std::string& what,
                              const std::string& remedy = {}, const std::string& dataset = {});
// Throws Error for a file that cannot be written; `fault` is an errno.
[[noreturn]] void refuse_to_write(const std::filesystem::path& file, int fault);

// A file that a program reads, and what it is to the user, such as "the history".
struct InputFile {
  std::string what;
  std::filesystem::path path;
};

// Throws Error if the output that `option` names is one of the inputs under this or another name: the same file has the
// same device and inode. Absent inputs, and empty paths, are no file.
void refuse_inputs_as_output(const std::string& option, const std::filesystem::path& out,
                             std::span<const InputFile> inputs);

// What an output is. An older file is replaced only if it is recognised as one of the same kind.
struct FileKind {
  const char* name;                                       // for texts, such as "a summary (JSON) of shearbus"
  bool (*recognises)(const std::filesystem::path& file);  // reads a regular file
};
// The first bytes of a file, at most `most`; fewer if it is shorter or cannot be read.
std::string head_of(const std::filesystem::path& file, std::size_t most);
extern const FileKind kSummaryFile;  // JSON with the provenance that our programs write
extern const FileKind kTableFile;    // CSV with the columns of a result
extern const FileKind kHdf5File;     // any HDF5 file; for files in a run's own directory

// Returns where a file is written that a user has named: the file itself, or what it points to if it is a symbolic
// link. Throws Error for a link of another user in a directory in which others can make links.
std::filesystem::path target_of_output(const std::filesystem::path& file);

// Throws Error if `file` is there and is of another kind, is no regular file, or is of another user in a directory to
// which everybody can write; or if its directory is not there. An empty file is of every kind.
void check_output(const std::filesystem::path& file, const FileKind& kind);

// A file being written under a name of its own, FILE.XXXXXX.partial, which is made anew beside FILE, never through a
// link, and locked as long as this object lives.
class PartialFile {
 public:
  // Whether one run at a time may write the file. The others are refused at the start or, where the file system has no
  // locks, at the end, in which case their result is kept under another name.
  enum class Writers { kOne, kAny };

  // Throws Error as check_output() does, or if the file cannot be made.
  PartialFile(const std::filesystem::path& file, const FileKind& kind, Writers writers, mode_t mode = 0666);
  ~PartialFile();  // removes the partial file unless it was published

  const std::filesystem::path& file() const { return file_; }  // the final name; links are followed
  const std::filesystem::path& path() const { return partial_; }
  int descriptor() const { return descriptor_; }
  bool replaces() const { return before_.has_value(); }  // whether there is an older file

  // Gives the finished file its name. When the function has returned, the name survives a loss of power.
  void publish();
  // The same. Returns the file, which stays locked until the caller closes it.
  wire::Descriptor publish_locked();

 private:
  void refuse_another_writer() const;
  void make(mode_t mode);
  [[noreturn]] void refuse_newer();

  std::filesystem::path file_, partial_;
  Writers writers_;
  std::optional<struct stat> before_;  // of an older file, to see whether another program has written it since
  wire::Descriptor descriptor_;
};

// Writes the text to `file` as a whole; on failure throws Error and leaves no partial file.
void write_whole(const std::filesystem::path& file, const FileKind& kind, std::string_view text);
// The same. Returns the file, which stays locked until the caller closes it.
wire::Descriptor write_whole_locked(const std::filesystem::path& file, const FileKind& kind, std::string_view text);

// Keeps a run's directory to one writer. Makes the directory if it is not there.
class OneWriter {
 public:
  // Throws Error if another run holds the directory.
  explicit OneWriter(const std::filesystem::path& directory);
  ~OneWriter();

 private:
  std::filesystem::path lock_;
  wire::Descriptor descriptor_;
};

}  // namespace shearbus::files
