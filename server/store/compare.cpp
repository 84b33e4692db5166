#include "server/store/compare.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cstring>
#include <fstream>
#include <optional>
#include <stdexcept>
#include <type_traits>
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

std::string name_of(const SessionImage& session) {
  return fmt::format("session {:.8}", hexadecimal(session.id));
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
          return fmt::format("{}, node {}, {}{}: {} and {} {}", where, node_ids[a.rows[row]], x.name,
                             x.width > 1 ? fmt::format(" {}", i) : "", x.values[at + i], y.values[at + i], x.units);
    }
  return {};
}

std::string difference(const std::string& where, const std::vector<MarkImage>& a, const std::vector<MarkImage>& b);

// Compares one field of two images of the same nodes.
template <typename Value>
std::string difference(const std::string& where, const char* what, const Value& a, const Value& b,
                       const std::vector<std::uint64_t>& node_ids) {
  if constexpr (std::is_integral_v<Value>) {
    return a == b ? std::string() : fmt::format("{}, {}: {} and {}", where, what, a, b);
  } else if constexpr (std::is_same_v<Value, shard::States>) {
    return difference(where, a, b, node_ids);
  } else if constexpr (std::is_same_v<Value, std::optional<shard::States>>) {
    if (a.has_value() != b.has_value()) return where + ": a " + what + " stands in one only";
    return a ? difference(where + ", " + what, *a, *b, node_ids) : std::string();
  } else if constexpr (std::is_same_v<Value, std::vector<MarkImage>>) {
    return difference(where, a, b);
  } else {
    return a == b ? std::string() : where + ": other " + what;
  }
}

// The first field that differs.
template <typename Image>
std::string difference_of(const std::string& where, const Image& a, const Image& b) {
  std::string text;
  Image::fields([&](const char*, auto member, const FieldOf& field) {
    if (text.empty() && field.compared != nullptr)
      text = difference(where, field.compared, a.*member, b.*member, a.node_ids);
  });
  return text;
}

std::string difference(const std::string& where, const std::vector<MarkImage>& a, const std::vector<MarkImage>& b) {
  if (a.size() != b.size()) return fmt::format("{}, marks: {} and {}", where, a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    const std::string mark = where + ", mark \"" + a[i].name + "\"";
    if (a[i].name != b[i].name) return mark + ": \"" + b[i].name + "\" there";
    if (std::string text = difference_of(mark, a[i], b[i]); !text.empty()) return text;
  }
  return {};
}

// Compares the nodes that sessions have offered and no session has accepted yet, in the order of the ids of the offers.
std::string difference_of_transfers(const Snapshot& a, const Snapshot& b) {
  const std::string where = "nodes offered";
  if (a.transfers.size() != b.transfers.size())
    return fmt::format("{}, offers: {} and {}", where, a.transfers.size(), b.transfers.size());
  for (std::size_t i = 0; i < a.transfers.size(); ++i)
    if (std::string text = difference_of(where, a.transfers[i], b.transfers[i]); !text.empty()) return text;
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
    if (session.open != partners[i]->open) return name_of(session) + ": open in one, closed in the other";
    if (std::string text = difference_of(name_of(session), session, *partners[i]); !text.empty()) return text;
  }
  if (!left.empty()) return name_of(*left.front()) + " is in " + b.string() + " only";
  return difference_of_transfers(one, other);
}

}  // namespace shearbus::store
