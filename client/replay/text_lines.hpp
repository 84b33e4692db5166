// The lines of a text file, whatever program wrote it.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

#include "proto/files/input_file.hpp"

namespace shearbus::replay {

// Reads a file in UTF-8, or in UTF-16 with its byte order mark, line by line; lines end in LF, CR LF or CR. Throws Error
// for a file that is no regular one or too large, and for a line that is too long or has a zero byte.
class TextLines {
 public:
  static constexpr std::size_t kMostLineBytes = 1 << 20;
  static constexpr std::size_t kMostFileBytes = std::size_t{2} << 30;

  explicit TextLines(const std::filesystem::path& file);

  // Reads the next line, without its end. Returns false at the end of the file.
  bool next(std::string& line);
  std::size_t number() const { return number_; }  // of the line that next() read, from 1 on, as editors count

 private:
  bool fill();
  void read_utf16(bool big_endian);
  [[noreturn]] void refuse(const std::string& what, const std::string& remedy) const;

  std::filesystem::path file_;
  files::RegularFile input_;
  std::string block_;  // read and not yet returned: from `at_` on
  std::size_t at_ = 0;
  std::size_t number_ = 0;
  bool after_cr_ = false;  // whether the line before ended in CR, so that an LF belongs to its end
};

}  // namespace shearbus::replay
