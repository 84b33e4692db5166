#include "proto/wire/text.hpp"

#include <utf8.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <ctime>
#include <vector>

namespace shearbus::wire {
namespace {

// Returns the Damerau-Levenshtein distance (optimal string alignment).
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> before(b.size() + 1), last(b.size() + 1), row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) last[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      row[j] = std::min({last[j] + 1, row[j - 1] + 1, last[j - 1] + (a[i - 1] == b[j - 1] ? 0U : 1U)});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1]) row[j] = std::min(row[j], before[j - 2] + 1);
    }
    before.swap(last);
    last.swap(row);
  }
  return last[b.size()];
}

}  // namespace

std::string utc_now() {
  const std::time_t now = std::time(nullptr);
  std::tm utc{};
  ::gmtime_r(&now, &utc);
  std::array<char, 32> text{};
  static_cast<void>(std::strftime(text.data(), text.size(), "%Y-%m-%dT%H:%M:%SZ", &utc));
  return text.data();
}

std::string hexadecimal(std::span<const std::uint8_t> bytes) {
  constexpr std::string_view kDigits = "0123456789abcdef";
  std::string digits;
  for (const std::uint8_t byte : bytes) digits += {kDigits[byte >> 4U], kDigits[byte & 15U]};
  return digits;
}

bool is_utf8(std::string_view text) {
  return utf8::is_valid(text.begin(), text.end());
}

bool has_control_character(std::string_view text) {
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto byte = static_cast<unsigned char>(text[i]);
    if (byte < 0x20 || byte == 0x7f) return true;
    // In UTF-8 the control characters U+0080 to U+009F are the bytes C2 80 to C2 9F.
    if (byte == 0xc2 && i + 1 < text.size() && static_cast<unsigned char>(text[i + 1]) < 0xa0) return true;
  }
  return false;
}

namespace {

// Whether a terminal or a reader would take the character for more than itself: control characters, line and paragraph
// separators, and those that change the direction of the text around them.
bool is_command(char32_t c) {
  return c < 0x20 || (c >= 0x7f && c < 0xa0) || c == 0x2028 || c == 0x2029 || (c >= 0x200e && c <= 0x200f) ||
         (c >= 0x202a && c <= 0x202e) || (c >= 0x2066 && c <= 0x2069) || c == 0x061c;
}

std::string escaped(char32_t c) {
  if (c == '\n') return "\\n";
  if (c == '\t') return "\\t";
  if (c == '\r') return "\\r";
  std::array<char, 16> text{};
  static_cast<void>(
      std::snprintf(text.data(), text.size(), c < 0x100 ? "\\x%02x" : "\\u{%04x}", static_cast<unsigned>(c)));
  return text.data();
}

// Appends the character or byte at the beginning of `text` to `out`, escaped if need be. Returns its length.
std::size_t append_printable(std::string_view text, std::string& out) {
  auto at = text.begin();
  char32_t c = static_cast<unsigned char>(text.front());
  bool valid = true;
  try {
    c = utf8::next(at, text.end());
  } catch (const utf8::exception&) {
    valid = false;
  }
  if (!valid) {
    out += escaped(c);
    return 1;
  }
  const auto size = static_cast<std::size_t>(at - text.begin());
  if (is_command(c))
    out += escaped(c);
  else
    out += text.substr(0, size);
  return size;
}

}  // namespace

std::string printable(std::string_view text, std::size_t max_bytes) {
  constexpr std::string_view kCut = "...";
  std::string out;
  std::size_t whole = 0;  // length of what fits in front of "..."
  while (!text.empty()) {
    if (out.size() + kCut.size() <= max_bytes) whole = out.size();
    text.remove_prefix(append_printable(text, out));
    if (out.size() > max_bytes) return out.substr(0, whole) + std::string(kCut.substr(0, max_bytes - whole));
  }
  return out;
}

std::string printable_lines(std::string_view text) {
  std::string out;
  out.reserve(text.size());
  while (!text.empty()) {
    if (text.front() == '\n') {
      out += '\n';
      text.remove_prefix(1);
    } else {
      text.remove_prefix(append_printable(text, out));
    }
  }
  return out;
}

std::string as_utf8(std::string_view text, std::size_t max_bytes) {
  constexpr std::string_view kCut = "...";
  std::string out(text.substr(0, max_bytes));
  auto invalid = utf8::find_invalid(out.begin(), out.end());
  while (invalid != out.end()) {
    *invalid = '?';
    invalid = utf8::find_invalid(invalid, out.end());
  }
  if (text.size() <= max_bytes) return out;
  const auto room = out.begin() + static_cast<std::ptrdiff_t>(max_bytes - std::min(max_bytes, kCut.size()));
  out.erase(utf8::find_invalid(out.begin(), room), out.end());  // cuts before a character, never inside
  return out.append(kCut.substr(0, max_bytes - out.size()));
}

bool is_domain_of_run(std::string_view domain, std::string_view name) {
  if (!domain.starts_with(name)) return false;
  domain.remove_prefix(name.size());
  if (domain.empty()) return true;
  const std::size_t bar = domain.find('/');
  const auto number = [](std::string_view text) {
    return !text.empty() && text.find_first_not_of("0123456789") == text.npos;
  };
  return domain.front() == '#' && bar != domain.npos && number(domain.substr(1, bar - 1)) &&
         number(domain.substr(bar + 1));
}

std::string_view nearest(std::string_view word, std::span<const std::string_view> candidates) {
  constexpr std::size_t kLongestWord = 128;  // a longer word is not a typing error
  if (word.size() > kLongestWord) return {};
  std::string_view best;
  std::size_t best_distance = SIZE_MAX;
  for (std::string_view candidate : candidates) {
    const std::size_t distance = edit_distance(word, candidate);
    const std::size_t longer = std::max(word.size(), candidate.size());
    if (distance < longer && distance <= std::max<std::size_t>(1, longer / 3) && distance < best_distance) {
      best = candidate;
      best_distance = distance;
    }
  }
  constexpr std::size_t kLeastPart = 4;
  if (best.empty() && word.size() >= kLeastPart)
    for (std::string_view candidate : candidates)
      if (const std::size_t at = candidate.find(word); at != candidate.npos && (at == 0 || candidate[at - 1] == '_') &&
                                                       (best.empty() || candidate.size() < best.size()))
        best = candidate;
  return best;
}

}  // namespace shearbus::wire
