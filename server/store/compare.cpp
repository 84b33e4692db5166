#include "server/store/compare.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cstring>
#include <fstream>
#include <stdexcept>
#include <vector>

#include "server/store/checkpoint.hpp"

namespace shearbus::store {
namespace {

Snapshot read(const std::filesystem::path& path) {
  if (std::filesystem::exists(path) && !std::filesystem::is_regular_file(path))
    throw std::runtime_error(path.string() + ": no file; expected a checkpoint, such as checkpoint-000000000001.h5");
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  const std::streamoff size = file ? static_cast<std::streamoff>(file.tellg()) : -1;
  if (size < 0) throw std::runtime_error(path.string() + ": cannot be read");
  std::vector<std::byte> bytes(static_cast<std::size_t>(size));
  file.seekg(0);
  file.read(reinterpret_cast<char*>(bytes.data()), size);
  if (!file) throw std::runtime_error(path.string() + ": cannot be read");
  // The generation is read from the footer, since a copy of a checkpoint may have any name.
  CheckpointFooter footer;
  if (bytes.size() >= sizeof footer) std::memcpy(&footer, bytes.data() + bytes.size() - sizeof footer, sizeof footer);
  return read_checkpoint(bytes, path.string(), footer.generation);
}

std::string number(double value) {
  std::array<char, 32> text{};
  // Returns the shortest text that reads back to the same bits.
  return {text.data(), std::to_chars(text.data(), text.data() + text.size(), value).ptr};
}
std::string number(std::uint64_t value) {
  return std::to_string(value);
}

std::string name_of(const SessionImage& session) {
  std::string name = "session ";
  for (std::size_t i = 0; i < 4; ++i) {
    constexpr const char* kDigits = "0123456789abcdef";
    name += kDigits[session.id[i] >> 4];
    name += kDigits[session.id[i] & 15];
  }
  return name;
}

template <typename Number>
std::string difference(const std::string& what, Number a, Number b) {
  return a == b ? std::string() : what + ": " + number(a) + " and " + number(b);
}

std::string difference(const std::string& where, const shard::States& a, const shard::States& b,
                       const std::vector<std::uint64_t>& node_ids) {
  if (a.rows != b.rows) return where + ": states of other nodes";
  if (a.columns.size() != b.columns.size()) return where + ": other quantities";
  // Report the first quantity of the first node that differs: nodes in the outer loop, quantities in the inner one.
  for (std::size_t row = 0; row < a.rows.size(); ++row)
    for (std::size_t c = 0; c < a.columns.size(); ++c) {
      const shard::StateColumn &x = a.columns[c], &y = b.columns[c];
      if (x.name != y.name || x.width != y.width) return where + ": other quantities, " + x.name + " and " + y.name;
      const std::size_t at = row * x.width;
      for (std::size_t i = 0; i < x.width; ++i)
        if (std::bit_cast<std::uint64_t>(x.values[at + i]) != std::bit_cast<std::uint64_t>(y.values[at + i]))
          return where + ", node " + number(node_ids[a.rows[row]]) + ", " + x.name +
                 (x.width > 1 ? std::string(" ").append(number(std::uint64_t{i})) : "") + ": " +
                 number(x.values[at + i]) + " and " + number(y.values[at + i]) + " " + x.units;
    }
  return {};
}

std::string difference_of_marks(const std::string& where, const SessionImage& a, const SessionImage& b) {
  if (std::string text = difference<std::uint64_t>(where + ", marks", a.marks.size(), b.marks.size()); !text.empty())
    return text;
  for (std::size_t i = 0; i < a.marks.size(); ++i) {
    const MarkImage &x = a.marks[i], &y = b.marks[i];
    const std::string mark = where + ", mark \"" + x.name + "\"";
    if (x.name != y.name) return mark + ": \"" + y.name + "\" there";
    if (x.node_ids != y.node_ids) return mark + ": other nodes, or in another order";
    std::string text = difference(mark + ", state version", x.state_version, y.state_version);
    if (text.empty()) text = difference(mark, x.states, y.states, x.node_ids);
    if (!text.empty()) return text;
  }
  return {};
}

std::string difference(const SessionImage& a, const SessionImage& b) {
  const std::string where = name_of(a);
  if (a.open != b.open) return where + ": open in one, closed in the other";
  std::string text = difference(where + ", last request", a.last_sequence, b.last_sequence);
  if (!text.empty() || !a.open) return text;
  if (a.scene != b.scene) return where + ": other scenes";
  if (a.node_ids != b.node_ids) return where + ": other nodes, or in another order";
  text = difference(where + ", state version", a.state_version, b.state_version);
  if (text.empty()) text = difference(where, a.committed, b.committed, a.node_ids);
  if (text.empty() && a.trial.has_value() != b.trial.has_value()) text = where + ": a trial stands in one only";
  if (text.empty() && (a.part_header != b.part_header || a.part_rows != b.part_rows))
    text = where + ": other parts of a step have come";
  if (text.empty() && a.trial) text = difference(where + ", trial", *a.trial, *b.trial, a.node_ids);
  return text.empty() ? difference_of_marks(where, a, b) : text;
}

// Compares the nodes that sessions have offered and no session has accepted yet, in the order of the ids of the offers.
std::string difference_of_transfers(const Snapshot& a, const Snapshot& b) {
  const std::string where = "nodes offered";
  if (std::string text = difference<std::uint64_t>(where + ", offers", a.transfers.size(), b.transfers.size());
      !text.empty())
    return text;
  for (std::size_t i = 0; i < a.transfers.size(); ++i) {
    const TransferImage &x = a.transfers[i], &y = b.transfers[i];
    if (x.node_ids != y.node_ids) return where + ": other nodes, or in another order";
    if (std::string text = difference(where, x.states, y.states, x.node_ids); !text.empty()) return text;
  }
  return {};
}

}  // namespace

std::string first_difference(const std::filesystem::path& a, const std::filesystem::path& b) {
  const Snapshot one = read(a);
  const Snapshot other = read(b);
  std::vector<const SessionImage*> left;
  for (const SessionImage& session : other.sessions) left.push_back(&session);
  const auto take = [&](auto matches) {
    const auto found = std::find_if(left.begin(), left.end(), matches);
    const SessionImage* session = found == left.end() ? nullptr : *found;
    if (session != nullptr) left.erase(found);
    return session;
  };
  std::vector<const SessionImage*> partners;
  for (const SessionImage& session : one.sessions)
    partners.push_back(take([&](const SessionImage* s) { return s->id == session.id; }));
  for (std::size_t i = 0; i < partners.size(); ++i) {
    const SessionImage& session = one.sessions[i];
    if (partners[i] == nullptr)
      partners[i] = take([&](const SessionImage* s) {
        return s->open == session.open && s->scene == session.scene && s->node_ids == session.node_ids;
      });
    if (partners[i] == nullptr) return name_of(session) + " is in " + a.string() + " only";
    if (std::string text = difference(session, *partners[i]); !text.empty()) return text;
  }
  if (!left.empty()) return name_of(*left.front()) + " is in " + b.string() + " only";
  return difference_of_transfers(one, other);
}

}  // namespace shearbus::store
