// The lines of a text file, whatever program wrote it.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>

namespace shearbus::replay {

// Reads a file in UTF-8, or in UTF-16 with its byte order mark; lines end in LF, CR LF or CR. Throws Error for a file
// that is no regular one or too large, and for a line that is too long or has a zero byte.
class TextLines {
 public:
  explicit TextLines(const std::filesystem::path& file);

  // Gives the next line, without its end. Returns false at the end of the file.
  bool next(std::string_view& line);
  std::size_t number() const { return number_; }  // of the line that next() gave, from 1 on, as editors count

 private:
  [[noreturn]] void refuse(const std::string& what, const std::string& remedy) const;

  std::filesystem::path file_;
  std::string text_;
  std::string_view rest_;  // behind the lines that next() gave
  std::size_t number_ = 0;
};

}  // namespace shearbus::replay
