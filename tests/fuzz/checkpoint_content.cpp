// What stands in a checkpoint, behind a right hash: a sound file, changed by calls of HDF5 and hashed again. The bytes
// that HDF5 itself parses stay sound: Debian's 1.10.8 is known to crash on malformed ones, which is why the hash comes
// first. Each edit of the input is eight bytes: what to do, to which object, and how.
#include <hdf5.h>
#include <xxhash.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <memory>
#include <string>

#include "server/store/checkpoint.hpp"
#include "server/store/hdf5_image.hpp"
#include "tests/fuzz/checkpoint_sample.hpp"
#include "tests/fuzz/mutate.hpp"
#include "tests/fuzz/target.hpp"

namespace shearbus::fuzz {
namespace {

constexpr std::size_t kMostEdits = 8;
constexpr std::size_t kEditBytes = 8;
constexpr std::size_t kMostBytes = 1 << 16;  // that an edit writes
constexpr std::uint64_t kMemory = std::uint64_t{1} << 20;
using Edit = std::array<std::uint8_t, kEditBytes>;

struct Target {
  std::string object;
  std::string attribute;  // empty: the object itself, by its link
};

store::Handle open_to_write(const std::vector<std::byte>& image) {
  const store::Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose, "make a property list");
  H5Pset_fapl_core(access.get(), 1 << 20, 0);
  H5Pset_file_image(access.get(), const_cast<std::byte*>(image.data()), image.size());
  return {H5Fopen(store::kImageName, H5F_ACC_RDWR, access.get()), H5Fclose, "open a file image"};
}

herr_t note_attribute(hid_t, const char* name, const H5A_info_t*, void* names) {
  static_cast<Parts*>(names)->push_back(name);
  return 0;
}
herr_t note_object(hid_t root, const char* name, const H5O_info_t*, void* found) {
  auto& targets = *static_cast<std::vector<Target>*>(found);
  if (std::string(name) != ".") targets.push_back({name, ""});
  const store::Handle object(H5Oopen(root, name, H5P_DEFAULT), H5Oclose, "open an object");
  Parts names;
  hsize_t at = 0;
  H5Aiterate2(object.get(), H5_INDEX_NAME, H5_ITER_INC, &at, note_attribute, &names);
  for (const std::string& attribute : names) targets.push_back({name, attribute});
  return 0;
}

struct Sample {
  std::vector<std::byte> image;
  std::vector<Target> targets;
};
const Sample& sample() {
  static const Sample made = [] {
    Sample sample{.image = sample_checkpoint(), .targets = {}};
    sample.image.resize(sample.image.size() - sizeof(store::CheckpointFooter));
    const store::Handle file = open_to_write(sample.image);
    H5Ovisit2(file.get(), H5_INDEX_NAME, H5_ITER_INC, note_object, &sample.targets, H5O_INFO_BASIC);
    return sample;
  }();
  return made;
}

store::Handle type_of(unsigned choice, unsigned size) {
  constexpr unsigned kTextBytes[] = {1, 5, 32, 1000, 1U << 16, 1U << 24, 1U << 31, 3};
  const auto copy = [](hid_t type) { return store::Handle(H5Tcopy(type), H5Tclose, "copy a type"); };
  switch (choice % 10) {
    case 0:
      return copy(H5T_STD_U64LE);
    case 1:
      return copy(H5T_IEEE_F64LE);
    case 2:
      return copy(H5T_STD_U32LE);
    case 3:
      return copy(H5T_STD_U8LE);
    case 4:
      return copy(H5T_STD_I64BE);
    case 5: {
      store::Handle text = copy(H5T_C_S1);
      H5Tset_size(text.get(), H5T_VARIABLE);
      return text;
    }
    case 6: {
      const hsize_t extent = 1 + size;
      return {H5Tarray_create2(H5T_STD_U64LE, 1, &extent), H5Tclose, "make an array type"};
    }
    case 7:
      return copy(H5T_STD_REF_OBJ);
    default: {
      store::Handle text = copy(H5T_C_S1);
      H5Tset_size(text.get(), kTextBytes[size % 8]);
      return text;
    }
  }
}

store::Handle space_of(const Edit& edit) {
  constexpr hsize_t kExtents[] = {0, 1, 2, 3, 5, 12, 1000, 1 << 20, hsize_t{1} << 40, hsize_t{1} << 61};
  const int rank = edit[4] % 5;
  if (rank == 0) return {H5Screate(H5S_SCALAR), H5Sclose, "make a space"};
  if (rank == 4) return {H5Screate(H5S_NULL), H5Sclose, "make a space"};
  const hsize_t extent[3] = {kExtents[edit[5] % 10], kExtents[edit[6] % 10], 1};
  return {H5Screate_simple(rank, extent, nullptr), H5Sclose, "make a space"};
}

// Zeros for the whole of it; nothing where that is much.
std::string zeros_for(const store::Handle& type, const store::Handle& space) {
  const hssize_t count = H5Sget_simple_extent_npoints(space.get());
  const std::size_t size = H5Tget_size(type.get());
  if (count <= 0 || static_cast<std::size_t>(count) > kMostBytes || size * static_cast<std::size_t>(count) > kMostBytes)
    return {};
  return std::string(size * static_cast<std::size_t>(count), '\0');
}

// Makes the attribute or dataset anew: another type, another extent, the same name.
void replace(const store::Handle& file, const Target& target, const Edit& edit) {
  const store::Handle type = type_of(edit[3], edit[7]);
  const store::Handle space = space_of(edit);
  const std::string zeros = zeros_for(type, space);
  if (!target.attribute.empty()) {
    const store::Handle object(H5Oopen(file.get(), target.object.c_str(), H5P_DEFAULT), H5Oclose, "open an object");
    H5Adelete(object.get(), target.attribute.c_str());
    const store::Handle made(
        H5Acreate2(object.get(), target.attribute.c_str(), type.get(), space.get(), H5P_DEFAULT, H5P_DEFAULT), H5Aclose,
        "make an attribute");
    if (!zeros.empty()) H5Awrite(made.get(), type.get(), zeros.data());
    return;
  }
  H5Ldelete(file.get(), target.object.c_str(), H5P_DEFAULT);
  const store::Handle made(
      H5Dcreate2(file.get(), target.object.c_str(), type.get(), space.get(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT),
      H5Dclose, "make a dataset");
  if (!zeros.empty()) H5Dwrite(made.get(), type.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, zeros.data());
}

// One value of it, of the same type and extent.
void overwrite(const store::Handle& file, const Target& target, const Edit& edit) {
  Random random(edit[3] + 256U * edit[4] + 65536U * edit[5]);
  if (!target.attribute.empty()) {
    const store::Handle attribute(
        H5Aopen_by_name(file.get(), target.object.c_str(), target.attribute.c_str(), H5P_DEFAULT, H5P_DEFAULT),
        H5Aclose, "open an attribute");
    const std::uint64_t value = random.number();
    H5Awrite(attribute.get(), H5T_NATIVE_UINT64, &value);  // fails for text, which stays
    return;
  }
  const store::Handle dataset(H5Dopen2(file.get(), target.object.c_str(), H5P_DEFAULT), H5Dclose, "open a dataset");
  const store::Handle type(H5Dget_type(dataset.get()), H5Tclose, "type a dataset");
  const store::Handle space(H5Dget_space(dataset.get()), H5Sclose, "size a dataset");
  const std::size_t size = H5Tget_size(type.get());
  std::string bytes = zeros_for(type, space);
  if (bytes.empty() || H5Tis_variable_str(type.get()) > 0) return;
  if (H5Dread(dataset.get(), type.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, bytes.data()) < 0) return;
  if (size == sizeof(double))
    mutate_reals(bytes, random);
  else
    bytes[random.below(bytes.size())] = static_cast<char>(random.number());
  H5Dwrite(dataset.get(), type.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, bytes.data());
}

void carry_out(const Edit& edit, const store::Handle& file) {
  const auto& targets = sample().targets;
  const Target& target = targets[(edit[1] + 256U * edit[2]) % targets.size()];
  const Target& other = targets[(edit[3] + 256U * edit[4]) % targets.size()];
  const char* object = target.object.c_str();
  switch (edit[0] % 6) {
    case 0:
      if (target.attribute.empty())
        H5Ldelete(file.get(), object, H5P_DEFAULT);
      else
        H5Adelete_by_name(file.get(), object, target.attribute.c_str(), H5P_DEFAULT);
      return;
    case 1:
      if (target.attribute.empty()) {
        H5Ldelete(file.get(), other.object.c_str(), H5P_DEFAULT);
        H5Lmove(file.get(), object, file.get(), other.object.c_str(), H5P_DEFAULT, H5P_DEFAULT);
      } else {
        H5Arename_by_name(file.get(), object, target.attribute.c_str(), other.attribute.c_str(), H5P_DEFAULT);
      }
      return;
    case 2:
      H5Ldelete(file.get(), object, H5P_DEFAULT);
      H5Lcreate_soft(("/" + other.object).c_str(), file.get(), object, H5P_DEFAULT, H5P_DEFAULT);
      return;
    case 3:
      return replace(file, target, edit);
    default:
      return overwrite(file, target, edit);
  }
}

std::vector<std::byte> edited(const std::uint8_t* data, std::size_t size) {
  std::vector<std::byte> bytes;
  {
    const store::Handle file = open_to_write(sample().image);
    for (std::size_t i = 0; i < kMostEdits && (i + 1) * kEditBytes <= size; ++i) {
      Edit edit{};
      std::memcpy(edit.data(), data + i * kEditBytes, kEditBytes);
      try {
        carry_out(edit, file);
      } catch (const store::Hdf5Error&) {
        // An edit before took the object away, or HDF5 knows no such thing.
      }
    }
    bytes = store::bytes_of_image(file);
  }
  const XXH128_hash_t sum = XXH3_128bits(bytes.data(), bytes.size());
  store::CheckpointFooter footer{
      .image_bytes = bytes.size(), .generation = kSampleGeneration, .image_sum = {sum.low64, sum.high64}};
  footer.sum = XXH3_64bits(&footer, offsetof(store::CheckpointFooter, sum));
  const auto end = std::as_bytes(std::span(&footer, 1));
  bytes.insert(bytes.end(), end.begin(), end.end());
  return bytes;
}

}  // namespace
}  // namespace shearbus::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace shearbus;
  const std::vector<std::byte> bytes = fuzz::edited(data, size);
  try {
    store::read_checkpoint(bytes, "file", fuzz::kSampleGeneration);
  } catch (const store::DamagedFile&) {
    return 0;
  }
  support::MemoryStorage disk;
  disk.put(store::checkpoint_name(fuzz::kSampleGeneration), bytes);
  std::unique_ptr<support::DurableServer> server;
  try {
    server = std::make_unique<support::DurableServer>(disk, store::Durability::kProcess, 99, 1, fuzz::kMemory);
  } catch (const std::exception& fault) {
    fuzz::require(*fault.what() != '\0', "a refusal to start says why");
    return 0;
  }
  fuzz::require(server->service.checkpoint(), "what was restored can be written again");
  return 0;
}

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size, std::size_t max_size,
                                               unsigned int seed) {
  using namespace shearbus::fuzz;
  Random random(seed);
  std::string edits(reinterpret_cast<const char*>(data), size / kEditBytes * kEditBytes);
  if (edits.empty() || (random.one_in(6) && edits.size() < kMostEdits * kEditBytes)) {
    for (std::size_t i = 0; i < kEditBytes; ++i) edits += static_cast<char>(random.number());
  } else if (random.one_in(8)) {
    edits.erase(kEditBytes * random.below(edits.size() / kEditBytes), kEditBytes);
  } else {
    edits[random.below(edits.size())] = static_cast<char>(random.number());
  }
  return give(edits, data, size, max_size);
}
