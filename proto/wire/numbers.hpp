// Numbers in texts of people: files and command lines. One rule for all of them.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <string_view>

namespace shearbus::wire {

inline constexpr std::size_t kMostNumberDigits = 100;  // characters of a number

// A finite number with a decimal point, without blanks; a number that is too small for a double is 0, as its nearest
// double. Nothing for any other text, such as "", "nan", "inf", "1e309", "0x10", or more than kMostNumberDigits.
std::optional<double> real_of(std::string_view text);

// A whole number from 0 to `most`, of digits alone. Nothing for any other text, such as "", "-1", "+1", "1e3", "0x10".
std::optional<std::uint64_t> count_of(std::string_view text,
                                      std::uint64_t most = std::numeric_limits<std::uint64_t>::max());

// A text of a stranger for a message: at most 60 bytes of it, in quotes.
std::string in_quotes(std::string_view text);

}  // namespace shearbus::wire
