// Checks that the C++ programs that test the library share: each fault is printed and counted.
#pragma once

#include <cstdio>
#include <optional>
#include <shearbus/client.hpp>
#include <string>

inline int faults = 0;

#define CHECK(what)                                                           \
  do {                                                                        \
    if (!(what)) {                                                            \
      std::fprintf(stderr, "%s:%d: not so: %s\n", __FILE__, __LINE__, #what); \
      ++faults;                                                               \
    }                                                                         \
  } while (0)
// Returns the refusal of a call, which must have this code and word.
#define REFUSED(call, code, word) refused([&] { call; }, code, word, __LINE__)
template <typename Call>
std::optional<shearbus::Error> refused(const Call& call, int code, const std::string& word, int line) {
  try {
    call();
    std::fprintf(stderr, "line %d: nothing was refused, expected %s\n", line, shearbus_code_name(code));
  } catch (const shearbus::Error& fault) {
    if (fault.code() == code && std::string(fault.what()).find(word) != std::string::npos) return fault;
    std::fprintf(stderr, "line %d: %s, expected %s ...%s...\n", line, fault.what(), shearbus_code_name(code),
                 word.c_str());
  }
  ++faults;
  return std::nullopt;
}
