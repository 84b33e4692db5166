// Text of the wire, which is valid UTF-8 of bounded length, and the known word nearest to a mistyped word.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace shearbus::wire {

bool is_utf8(std::string_view text);

// Letters of ASCII, whatever the locale of the process is: tolower() of a Turkish one leaves I as it is.
constexpr char ascii_lower(char c) {
  return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
}
constexpr bool is_ascii_alphanumeric(char c) {
  return (c >= '0' && c <= '9') || (ascii_lower(c) >= 'a' && ascii_lower(c) <= 'z');
}

// The present time in UTC, to a second, by ISO 8601: "2026-01-31T12:00:00Z".
std::string utc_now();

// A number of things, "1 node" or "3 nodes".
inline std::string counted(std::uint64_t count, std::string_view noun) {
  return std::to_string(count).append(" ").append(noun).append(count == 1 ? "" : "s");
}

// The hexadecimal digits of bytes: two of each, small letters.
std::string hexadecimal(std::span<const std::uint8_t> bytes);

// Returns true if a valid UTF-8 text has a control character: U+0000 to U+001F or U+007F to U+009F. Names must have
// none.
bool has_control_character(std::string_view text);

// Returns a text of a stranger (a name, a key, a file's content) as it may appear in a message, a log or on a terminal: on
// one line and without commands to a terminal. Control characters and characters that change the direction of text become
// "\n", "\t" or "\x1b", "\u{202e}", invalid bytes "\xff". Of a longer text than `max_bytes` the beginning and "...".
std::string printable(std::string_view text, std::size_t max_bytes);

// The same for a whole message, in which line ends stay.
std::string printable_lines(std::string_view text);

// Whether a session's domain is that of a run: of its name, or of the form NAME#K/N that it has on the K-th of N servers.
bool is_domain_of_run(std::string_view domain, std::string_view name);

// The server's warnings about a scene that only inform begin with this; the others tell of a probable mistake.
inline constexpr std::string_view kNote = "note: ";

// Returns a warning about a scene as a line to show: a note as it is, another text after "warning: ".
inline std::string labelled(const std::string& warning) {
  return warning.starts_with(kNote) ? warning : "warning: " + warning;
}

// Returns `text` with every invalid byte replaced by '?', cut at a character boundary to at most `max_bytes`; a text
// that was cut ends in "...".
std::string as_utf8(std::string_view text, std::size_t max_bytes);

// Returns the candidate with the smallest edit distance to a mistyped word; a swap of neighbouring letters counts once.
// If the distance exceeds a third of the longer word's length (but at least 1), or equals that length, returns the
// shortest candidate of which the word is a part ("density" of "density_kg_per_m3"), or "".
std::string_view nearest(std::string_view word, std::span<const std::string_view> candidates);

}  // namespace shearbus::wire
