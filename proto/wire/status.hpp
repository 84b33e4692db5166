// The status of a reply: a code for programs, a text and a remedy for people.
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <vector>

#include "proto/wire/enums.hpp"
#include "proto/wire/field_rows.hpp"

namespace shearbus::wire {

// Returns the name that users see, e.g. "SEQUENCE_GAP".
const char* name(Code code);

inline constexpr std::size_t kMaxNodesNamed = 16;

struct Status {
  Code code = Code::kOk;
  std::string text;                     // what was expected and what was found
  std::string remedy;                   // proposed action
  std::string field;                    // scene field ("layer.cells") or column ("pressure_pa") at fault
  std::vector<std::uint64_t> node_ids;  // nodes at fault, at most kMaxNodesNamed
  std::uint64_t last_sequence = 0;      // set if the code is one of the sequence codes 201 to 203

  bool ok() const { return code == Code::kOk; }

  static void fields(auto&& v, auto& m) {
    v(1, "code", required(m.code));
    v(2, "text", long_text(m.text));
    v(3, "remedy", m.remedy);
    v(4, "field", m.field);
    v(5, "node_ids", at_most_fixed(kMaxNodesNamed, m.node_ids));
    v(6, "last_sequence", m.last_sequence);
  }
};

// Returns the status as one line: "INVALID_VALUE: pressure_pa of node 7 is nan; ... (remedy)".
std::string describe(const Status& status);

// Makes the texts of a status printable, each one line; the text of INVALID_SCENE alone has a line for each fault.
Status& make_printable(Status& status);

class Error : public std::runtime_error {
 public:
  // Makes the texts of the status printable: they may quote what strangers wrote.
  explicit Error(Status status) : Error(std::move(status), Printable()) {}
  const Status& status() const { return status_; }

 private:
  struct Printable {};
  Error(Status&& status, Printable)
      : std::runtime_error(describe(make_printable(status))), status_(std::move(status)) {}

  Status status_;
};

}  // namespace shearbus::wire
