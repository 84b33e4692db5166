#include "proto/wire/numbers.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <system_error>

#include "proto/wire/text.hpp"

namespace shearbus::wire {
namespace {

// Whether a number that no double holds is too small for one. `text` is a number as from_chars reads it.
bool is_too_small(std::string_view text) {
  const auto e = text.find_first_of("eE");
  const std::string_view digits = text.substr(0, e);
  long power = 0;  // of the first digit that is not 0
  const auto first = digits.find_first_of("123456789");
  if (first == std::string_view::npos) return true;
  const auto point = std::min(digits.find('.'), digits.size());
  power = first < point ? static_cast<long>(point - first) - 1 : static_cast<long>(point) - static_cast<long>(first);
  if (e == std::string_view::npos) return power < 0;
  std::string_view exponent = text.substr(e + 1);
  if (exponent.starts_with('+')) exponent.remove_prefix(1);
  long written = 0;
  const auto [end, fault] = std::from_chars(exponent.data(), exponent.data() + exponent.size(), written);
  if (fault == std::errc::result_out_of_range) return exponent.starts_with('-');
  return written < -power;
}

}  // namespace

std::optional<double> real_of(std::string_view text) {
  if (text.size() > kMostNumberDigits) return std::nullopt;
  if (text.starts_with('+') && text.size() > 1 && text[1] != '-') text.remove_prefix(1);
  double value = 0.0;
  const auto [end, fault] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (end != text.data() + text.size() || text.empty()) return std::nullopt;
  if (fault == std::errc::result_out_of_range) return is_too_small(text) ? std::optional(0.0) : std::nullopt;
  if (fault != std::errc() || !std::isfinite(value)) return std::nullopt;
  return value;
}

std::optional<std::uint64_t> count_of(std::string_view text, std::uint64_t most) {
  std::uint64_t value = 0;
  const auto [end, fault] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty() || fault != std::errc() || end != text.data() + text.size() || value > most) return std::nullopt;
  return value;
}

std::string in_quotes(std::string_view text) {
  constexpr std::size_t kMost = 60;
  return '"' + as_utf8(text, kMost) + '"';
}

}  // namespace shearbus::wire
