// Fuzzes the reading of a checkpoint from a disk. The reader passes bytes to HDF5 only if their hash is right, and the
// mutator of this target repairs only the checksums of the footer. The fuzz target checkpoint_content covers content
// with a correct hash. Nothing is accepted but what was written.
#include <xxhash.h>

#include <cstring>

#include "server/store/checkpoint.hpp"
#include "tests/fuzz/checkpoint_sample.hpp"
#include "tests/fuzz/mutate.hpp"
#include "tests/fuzz/target.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace shearbus;
  try {
    const store::Snapshot snapshot =
        store::read_checkpoint(std::as_bytes(std::span(data, size)), "file", fuzz::kSampleGeneration);
    // The checksum is correct, so checkpoint_bytes() of this or an earlier version has written this content. What this
    // one writes of it must be read again as the same.
    const auto written = store::checkpoint_bytes(snapshot, fuzz::kSampleGeneration);
    const store::Snapshot again =
        store::read_checkpoint(std::as_bytes(std::span(written)), "file", fuzz::kSampleGeneration);
    fuzz::require(store::checkpoint_bytes(again, fuzz::kSampleGeneration).size() == written.size(),
                  "what was read is what is written");
  } catch (const store::DamagedFile&) {
  }
  return 0;
}

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size,
                                               unsigned int seed) {
  using namespace shearbus;
  fuzz::Random random(seed);
  store::CheckpointFooter footer;
  if (size < sizeof footer || random.one_in(3)) return LLVMFuzzerMutate(data, size, max_size);
  std::uint8_t* end = data + size - sizeof footer;
  std::memcpy(&footer, end, sizeof footer);
  switch (random.below(4)) {
    case 0:
      footer.image_bytes = random.one_in(2) ? size - sizeof footer : random.number();
      break;
    case 1:
      footer.generation = random.one_in(2) ? fuzz::kSampleGeneration : random.number();
      break;
    case 2:
      footer.image_sum[random.below(2)] = random.number();
      break;
    default:
      footer.version = static_cast<std::uint32_t>(random.number());
  }
  footer.sum = XXH3_64bits(&footer, offsetof(store::CheckpointFooter, sum));
  std::memcpy(end, &footer, sizeof footer);
  return size;
}
