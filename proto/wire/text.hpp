// Text of the wire, which is valid UTF-8 of bounded length, and the known word nearest to a mistyped word.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <string_view>

namespace shearbus::wire {

bool is_utf8(std::string_view text);

// Whether a valid UTF-8 text has a control character: U+0000 to U+001F or U+007F to U+009F. A name has none.
bool has_control_character(std::string_view text);

// `text` with every invalid byte replaced by '?', cut at a character boundary to at most `max_bytes`; a text that was
// cut ends in "...".
std::string as_utf8(std::string_view text, std::size_t max_bytes);

// The candidate nearest to a mistyped word: the smallest edit distance (a swap of neighbours counts once), at most a
// third of the longer word, with at least one common letter; empty if there is none.
std::string_view nearest(std::string_view word, std::span<const std::string_view> candidates);

}  // namespace shearbus::wire
