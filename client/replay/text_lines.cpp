#include "client/replay/text_lines.hpp"

#include <fmt/format.h>
#include <utf8.h>

#include <cstdint>
#include <iterator>

#include "proto/files/input_file.hpp"

namespace shearbus::replay {
namespace {

constexpr std::size_t kMostLineBytes = 1 << 20;
constexpr std::size_t kMostFileBytes = std::size_t{2} << 30;

// Throws utf8::exception for units that are half a pair.
std::string utf8_of_utf16(std::string_view text, bool big_endian) {
  std::u16string units;
  for (std::size_t at = 0; at + 1 < text.size(); at += 2) {
    const auto first = static_cast<std::uint8_t>(text[at]);
    const auto second = static_cast<std::uint8_t>(text[at + 1]);
    units += static_cast<char16_t>(big_endian ? first << 8 | second : second << 8 | first);
  }
  std::string made;
  utf8::utf16to8(units.begin(), units.end(), std::back_inserter(made));
  return made;
}

}  // namespace

TextLines::TextLines(const std::filesystem::path& file) : file_(file) {
  const files::RegularFile input(file);
  if (input.size() > kMostFileBytes)
    refuse(fmt::format("has {} bytes; a table of text has at most {}", input.size(), kMostFileBytes),
           "Write it as HDF5, which is read row by row.");
  text_.resize(input.size());
  std::size_t size = 0;
  while (const std::size_t taken = input.read(text_.data() + size, text_.size() - size, file)) size += taken;
  text_.resize(size);
  const bool utf16 = text_.starts_with("\xff\xfe") || text_.starts_with("\xfe\xff");
  if (utf16 && size % 2 != 0) refuse("is UTF-16 by its first bytes, but has an odd number of bytes", "");
  try {
    if (utf16) text_ = utf8_of_utf16(std::string_view(text_).substr(2), text_.starts_with("\xfe"));
  } catch (const utf8::exception&) {
    refuse("is UTF-16 by its first bytes, but a unit is half a pair", "");
  }
  rest_ = text_;
  if (rest_.starts_with("\xef\xbb\xbf")) rest_.remove_prefix(3);
}

void TextLines::refuse(const std::string& what, const std::string& remedy) const {
  throw wire::Error({.code = wire::Code::kInvalidValue,
                     .text = number_ == 0 ? fmt::format("{}: {}", file_.string(), what)
                                          : fmt::format("{}, line {}: {}", file_.string(), number_, what),
                     .remedy = remedy});
}

bool TextLines::next(std::string_view& line) {
  if (rest_.empty()) return false;
  ++number_;
  const std::size_t end = rest_.find_first_of("\r\n");
  line = rest_.substr(0, end);
  if (line.size() > kMostLineBytes)
    refuse(fmt::format("has more than {} bytes, which no row of a table has", kMostLineBytes),
           "Is it a table? Lines end in LF, CR LF or CR.");
  if (line.find('\0') != line.npos)
    refuse("has a zero byte", "Save the table as UTF-8, or as UTF-16 with its byte order mark.");
  rest_.remove_prefix(line.size());
  rest_.remove_prefix(rest_.starts_with("\r\n") ? 2 : rest_.empty() ? 0 : 1);
  return true;
}

}  // namespace shearbus::replay
