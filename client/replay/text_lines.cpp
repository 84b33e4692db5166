#include "client/replay/text_lines.hpp"

#include <fmt/format.h>

#include <cstdint>

namespace shearbus::replay {
namespace {

constexpr std::size_t kBlockBytes = 1 << 16;

// Appends a code point in UTF-8.
void append_utf8(std::string& text, std::uint32_t point) {
  const auto byte = [&](std::uint32_t bits) { text += static_cast<char>(bits); };
  if (point < 0x80) {
    byte(point);
  } else if (point < 0x800) {
    byte(0xc0 | point >> 6);
    byte(0x80 | (point & 0x3f));
  } else if (point < 0x10000) {
    byte(0xe0 | point >> 12);
    byte(0x80 | (point >> 6 & 0x3f));
    byte(0x80 | (point & 0x3f));
  } else {
    byte(0xf0 | point >> 18);
    byte(0x80 | (point >> 12 & 0x3f));
    byte(0x80 | (point >> 6 & 0x3f));
    byte(0x80 | (point & 0x3f));
  }
}

}  // namespace

TextLines::TextLines(const std::filesystem::path& file) : file_(file), input_(file) {
  if (input_.size() > kMostFileBytes)
    refuse(fmt::format("has {} bytes; a table of text has at most {}", input_.size(), kMostFileBytes),
           "Write it as HDF5, which is read row by row.");
  fill();
  if (block_.starts_with("\xef\xbb\xbf"))
    at_ = 3;
  else if (block_.starts_with("\xff\xfe") || block_.starts_with("\xfe\xff"))
    read_utf16(block_.starts_with("\xfe\xff"));
}

void TextLines::refuse(const std::string& what, const std::string& remedy) const {
  throw wire::Error({.code = wire::Code::kInvalidValue,
                     .text = number_ == 0 ? fmt::format("{}: {}", file_.string(), what)
                                          : fmt::format("{}, line {}: {}", file_.string(), number_, what),
                     .remedy = remedy});
}

// Appends the next bytes of the file to the block. Returns false at its end.
bool TextLines::fill() {
  block_.erase(0, at_);
  at_ = 0;
  const std::size_t before = block_.size();
  block_.resize(before + kBlockBytes);
  const std::size_t taken = input_.read(block_.data() + before, kBlockBytes, file_);
  block_.resize(before + taken);
  return taken > 0;
}

// Reads the whole file, and makes UTF-8 of it.
void TextLines::read_utf16(bool big_endian) {
  while (fill()) {
  }
  if (block_.size() % 2 != 0) refuse("is UTF-16 by its first bytes, but has an odd number of bytes", "");
  const auto unit = [&](std::size_t at) {
    const auto first = static_cast<std::uint8_t>(block_[at]);
    const auto second = static_cast<std::uint8_t>(block_[at + 1]);
    return static_cast<std::uint32_t>(big_endian ? first << 8 | second : second << 8 | first);
  };
  std::string text;
  for (std::size_t at = 2; at < block_.size(); at += 2) {
    std::uint32_t point = unit(at);
    if (point >= 0xd800 && point < 0xe000) {
      const std::uint32_t low = point < 0xdc00 && at + 2 < block_.size() ? unit(at + 2) : 0;
      if (low < 0xdc00 || low >= 0xe000)
        refuse(fmt::format("is UTF-16 by its first bytes; the unit at byte {} is half a pair", at), "");
      point = 0x10000 + ((point - 0xd800) << 10) + (low - 0xdc00);
      at += 2;
    }
    append_utf8(text, point);
  }
  block_ = std::move(text);
}

bool TextLines::next(std::string& line) {
  std::size_t looked = at_;
  for (;;) {
    if (after_cr_ && looked < block_.size()) {
      if (block_[looked] == '\n') at_ = ++looked;
      after_cr_ = false;
    }
    const std::size_t end = after_cr_ ? std::string::npos : block_.find_first_of("\r\n", looked);
    const std::size_t length = (end == std::string::npos ? block_.size() : end) - at_;
    if (length > kMostLineBytes) {
      ++number_;
      refuse(fmt::format("has more than {} bytes, which no row of a table has", kMostLineBytes),
             "Is it a table? Lines end in LF, CR LF or CR.");
    }
    if (end != std::string::npos) {
      line.assign(block_, at_, length);
      after_cr_ = block_[end] == '\r';
      at_ = end + 1;
      break;
    }
    looked = length;  // in the block without what was returned
    if (fill()) continue;
    if (block_.empty()) return false;
    line = std::move(block_);
    block_.clear();
    break;
  }
  ++number_;
  if (line.find('\0') != std::string::npos)
    refuse("has a zero byte", "Save the table as UTF-8, or as UTF-16 with its byte order mark.");
  return true;
}

}  // namespace shearbus::replay
