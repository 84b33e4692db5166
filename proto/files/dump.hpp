// A restart dump on disk: arrays and texts by name in one HDF5 file, which appears only when complete. Every value is
// checksummed; a flipped bit is an error. All functions throw wire::Error with the file in the text: kNoSpace for a
// full disk, otherwise kInvalidValue.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace shearbus::files {

class DumpWriter {
 public:
  // Creates FILE.partial, which only the owner may read, because a dump may hold the resume token of a session.
  explicit DumpWriter(const std::filesystem::path& file);
  DumpWriter(const DumpWriter&) = delete;
  DumpWriter& operator=(const DumpWriter&) = delete;
  ~DumpWriter();  // removes the partial file unless the writer was closed

  void numbers(const std::string& name, std::span<const double> values);
  void counts(const std::string& name, std::span<const std::uint64_t> values);
  void text(const std::string& name, std::string_view value);
  void close();  // returns when the file is on the disk under its final name

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Reads the whole dump in the constructor, so that damage is found before a value is used.
class DumpReader {
 public:
  explicit DumpReader(std::filesystem::path file);

  const std::vector<double>& numbers(const std::string& name) const;
  const std::vector<std::uint64_t>& counts(const std::string& name) const;
  const std::string& text(const std::string& name) const;
  // Fills `values`, which must have the length of the array in the dump.
  void fill(const std::string& name, std::span<double> values) const;
  void fill(const std::string& name, std::span<std::uint64_t> values) const;

  const std::filesystem::path& file() const { return file_; }

 private:
  std::filesystem::path file_;
  std::map<std::string, std::vector<double>> numbers_;
  std::map<std::string, std::vector<std::uint64_t>> counts_;
  std::map<std::string, std::string> texts_;
};

}  // namespace shearbus::files
