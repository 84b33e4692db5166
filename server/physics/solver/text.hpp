// Puts sentences with numbers together, for warnings and refusals.
#pragma once

#include <locale>
#include <sstream>
#include <string>

namespace shearbus::physics {

// A number to be printed with `digits` digits; a plain number is printed with six.
struct Digits {
  int digits;
  double value;
};
inline std::ostream& operator<<(std::ostream& text, Digits number) {
  const std::streamsize before = text.precision(number.digits);
  text << number.value;
  text.precision(before);
  return text;
}

template <class... Parts>
std::string text_of(const Parts&... parts) {
  std::ostringstream text;
  text.imbue(std::locale::classic());  // whatever locale the host has chosen
  (text << ... << parts);
  return text.str();
}

}  // namespace shearbus::physics
