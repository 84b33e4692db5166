// Fuzzes the reading of a journal segment from a disk, and the recovery of a server from the segment. What was read is
// what is written; a server recovers from it or says why not.
#include <algorithm>

#include "server/store/journal.hpp"
#include "tests/fuzz/mutate.hpp"
#include "tests/fuzz/target.hpp"
#include "tests/support/durable_server.hpp"
#include "tests/support/memory_storage.hpp"

namespace shearbus::fuzz {
namespace {

constexpr std::uint64_t kMemory = std::uint64_t{1} << 20;

std::vector<std::byte> written(const store::Segment& segment) {
  support::MemoryStorage disk;
  store::JournalWriter writer(disk, store::segment_name(segment.number), segment, false);
  for (const store::Record& record : segment.records) writer.append(record);
  return disk.bytes(store::segment_name(segment.number));
}

void recover(const store::Segment& segment, const std::vector<std::byte>& bytes) {
  support::MemoryStorage disk;
  disk.put(store::segment_name(segment.number), bytes);
  try {
    support::DurableServer server(disk, store::Durability::kProcess, 99, 1, kMemory);
    wire::Request query;
    query.body = wire::ServerStatusQuery{};
    require(server.ask(query).code() == wire::Code::kOk, "a server that has recovered answers");
  } catch (const std::exception& fault) {
    require(*fault.what() != '\0', "a refusal to start says why");
  }
}

store::Bytes some(const std::string& bytes) {
  return std::as_bytes(std::span(bytes));
}

}  // namespace
}  // namespace shearbus::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace shearbus;
  const auto input = std::as_bytes(std::span(data, size));
  const std::vector<std::byte> bytes(input.begin(), input.end());
  store::Segment segment;
  try {
    segment = store::read_segment(bytes, "file");
  } catch (const store::DamagedFile&) {
    return 0;
  }
  fuzz::require(segment.sound_bytes <= bytes.size(), "what is sound lies within the file");
  if (segment.sound_bytes == 0) return 0;
  const auto again = fuzz::written(segment);
  // Not compared: the number of settled records in the header, which a server writes later than the rest of the header.
  constexpr std::ptrdiff_t kSettled = offsetof(store::SegmentHeader, settled);
  constexpr std::ptrdiff_t kRecords = sizeof(store::SegmentHeader);
  fuzz::require(again.size() == segment.sound_bytes &&
                    std::equal(again.begin(), again.begin() + kSettled, bytes.begin()) &&
                    std::equal(again.begin() + kRecords, again.end(), bytes.begin() + kRecords),
                "what was read is what is written");
  fuzz::recover(segment, bytes);
  return 0;
}

// Mutates mostly whole records of the journal and corrects their checksums, so that the input reaches the code that
// runs after the checks.
extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size,
                                               unsigned int seed) {
  using namespace shearbus;
  fuzz::Random random(seed);
  if (random.one_in(6)) return LLVMFuzzerMutate(data, size, max_size);
  store::Segment segment;
  try {
    segment = store::read_segment(std::as_bytes(std::span(data, size)), "file");
  } catch (const store::DamagedFile&) {
    return LLVMFuzzerMutate(data, size, max_size);
  }
  auto& records = segment.records;
  if (records.empty()) return LLVMFuzzerMutate(data, size, max_size);
  const std::size_t at = random.below(records.size());
  const auto text = [](store::Bytes bytes) {
    return std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  };
  std::string header = text(records[at].header_frame);
  std::string payload = text(records[at].payload_frame);
  const auto put = [&] {
    records[at].header_frame = fuzz::some(header);
    records[at].payload_frame = fuzz::some(payload);
  };
  switch (random.below(9)) {
    case 0:
      segment.number = random.number();
      segment.first_index = random.one_in(2) ? 0 : random.number();
      break;
    case 1:
      records.erase(records.begin() + static_cast<std::ptrdiff_t>(at));
      break;
    case 2:
      records.push_back(records[at]);
      break;
    case 3:
      std::swap(records[at], records[random.below(records.size())]);
      break;
    case 4:
      records[at].sequence = random.number();
      break;
    case 5:
      fuzz::mutate_reals(payload, random);
      fuzz::mend_payload(header, payload, false);
      put();
      break;
    case 6:
      fuzz::mutate_bytes(header, header.size() + 16);
      put();
      break;
    default:
      fuzz::mutate_header(header, false, random);
      put();
  }
  const auto bytes = fuzz::written(segment);
  return fuzz::give({reinterpret_cast<const char*>(bytes.data()), bytes.size()}, data, size, max_size);
}
