// Fuzzes the reading of a checkpoint with wrong content but a correct hash. HDF5 calls change a sound file, which is
// then hashed again. The bytes that HDF5 itself parses stay sound, because HDF5 1.10.8 of Debian is known to crash on
// malformed bytes; for this reason the reader checks the hash first. The fuzzer's input is a list of edits of eight
// bytes each: operation, object and parameters.
#include <hdf5.h>
#include <xxhash.h>

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
constexpr std::size_t kMostBytes = 1 << 16;  // largest size of the content that one edit writes [bytes]
constexpr std::uint64_t kMemory = std::uint64_t{1} << 20;
using Edit = std::array<std::uint8_t, kEditBytes>;

struct Target {
  std::string object;
  std::string attribute;  // name of an attribute of the object; empty: the edit applies to the object itself
};

hdf5::File open_to_write(const std::vector<std::byte>& image) {
  const hdf5::Properties access(hdf5::checked(H5Pcreate(H5P_FILE_ACCESS), "make a property list"));
  H5Pset_fapl_core(access, 1 << 20, 0);
  H5Pset_file_image(access, const_cast<std::byte*>(image.data()), image.size());
  return hdf5::File(hdf5::checked(H5Fopen(store::kImageName, H5F_ACC_RDWR, access), "open a file image"));
}

herr_t note_attribute(hid_t, const char* name, const H5A_info_t*, void* names) {
  static_cast<Parts*>(names)->push_back(name);
  return 0;
}
herr_t note_object(hid_t root, const char* name, const H5O_info_t*, void* found) {
  auto& targets = *static_cast<std::vector<Target>*>(found);
  if (std::string(name) != ".") targets.push_back({name, ""});
  const hdf5::Object object(hdf5::checked(H5Oopen(root, name, H5P_DEFAULT), "open an object"));
  Parts names;
  hsize_t at = 0;
  H5Aiterate2(object, H5_INDEX_NAME, H5_ITER_INC, &at, note_attribute, &names);
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
    const hdf5::File file = open_to_write(sample.image);
    H5Ovisit2(file, H5_INDEX_NAME, H5_ITER_INC, note_object, &sample.targets, H5O_INFO_BASIC);
    return sample;
  }();
  return made;
}

hdf5::Type type_of(unsigned choice, unsigned size) {
  constexpr unsigned kTextBytes[] = {1, 5, 32, 1000, 1U << 16, 1U << 24, 1U << 31, 3};
  const auto copy = [](hid_t type) { return hdf5::Type(hdf5::checked(H5Tcopy(type), "copy a type")); };
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
      hdf5::Type text = copy(H5T_C_S1);
      H5Tset_size(text, H5T_VARIABLE);
      return text;
    }
    case 6: {
      const hsize_t extent = 1 + size;
      return hdf5::Type(hdf5::checked(H5Tarray_create2(H5T_STD_U64LE, 1, &extent), "make an array type"));
    }
    case 7:
      return copy(H5T_STD_REF_OBJ);
    default: {
      hdf5::Type text = copy(H5T_C_S1);
      H5Tset_size(text, kTextBytes[size % 8]);
      return text;
    }
  }
}

hdf5::Space space_of(const Edit& edit) {
  constexpr hsize_t kExtents[] = {0, 1, 2, 3, 5, 12, 1000, 1 << 20, hsize_t{1} << 40, hsize_t{1} << 61};
  const int rank = edit[4] % 5;
  if (rank == 0) return hdf5::Space(hdf5::checked(H5Screate(H5S_SCALAR), "make a space"));
  if (rank == 4) return hdf5::Space(hdf5::checked(H5Screate(H5S_NULL), "make a space"));
  const hsize_t extent[3] = {kExtents[edit[5] % 10], kExtents[edit[6] % 10], 1};
  return hdf5::Space(hdf5::checked(H5Screate_simple(rank, extent, nullptr), "make a space"));
}

// Returns zero bytes for as many values of `type` as the dataspace has, or an empty string if they exceed kMostBytes.
std::string zeros_for(hid_t type, hid_t space) {
  const hssize_t count = H5Sget_simple_extent_npoints(space);
  const std::size_t size = H5Tget_size(type);
  if (count <= 0 || static_cast<std::size_t>(count) > kMostBytes || size * static_cast<std::size_t>(count) > kMostBytes)
    return {};
  return std::string(size * static_cast<std::size_t>(count), '\0');
}

// Replaces an attribute or a dataset by one of the same name with another type and extent.
void replace(hid_t file, const Target& target, const Edit& edit) {
  const hdf5::Type type = type_of(edit[3], edit[7]);
  const hdf5::Space space = space_of(edit);
  const std::string zeros = zeros_for(type, space);
  if (!target.attribute.empty()) {
    const hdf5::Object object(hdf5::checked(H5Oopen(file, target.object.c_str(), H5P_DEFAULT), "open an object"));
    H5Adelete(object, target.attribute.c_str());
    const hdf5::Attribute made(hdf5::checked(
        H5Acreate2(object, target.attribute.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT), "make an attribute"));
    if (!zeros.empty()) H5Awrite(made, type, zeros.data());
    return;
  }
  H5Ldelete(file, target.object.c_str(), H5P_DEFAULT);
  const hdf5::Dataset made(hdf5::checked(
      H5Dcreate2(file, target.object.c_str(), type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), "make a dataset"));
  if (!zeros.empty()) H5Dwrite(made, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, zeros.data());
}

// Changes one of the values of `size` bytes each in `bytes`. An attribute of eight bytes is a number, a dataset has reals.
void change_one(std::string& bytes, std::size_t size, bool reals, Random& random) {
  if (size != sizeof(double)) {
    bytes[random.below(bytes.size())] = static_cast<char>(random.number());
  } else if (reals) {
    mutate_reals(bytes, random);
  } else {
    const std::uint64_t value = random.number();
    std::memcpy(bytes.data() + size * random.below(bytes.size() / size), &value, size);
  }
}

// Changes one value of an attribute or a dataset; type and extent stay. Reads and writes whole values of the type that the
// file has: an earlier edit may have given the object another type and another number of values than the sample.
void overwrite(hid_t file, const Target& target, const Edit& edit) {
  Random random(edit[3] + 256U * edit[4] + 65536U * edit[5]);
  const bool of_object = !target.attribute.empty();
  const hdf5::Object object(hdf5::checked(H5Oopen(file, target.object.c_str(), H5P_DEFAULT), "open an object"));
  const hdf5::Attribute attribute(
      of_object ? hdf5::checked(H5Aopen(object, target.attribute.c_str(), H5P_DEFAULT), "open an attribute")
                : H5I_INVALID_HID);
  if (!of_object && H5Iget_type(object) != H5I_DATASET) return;
  const hdf5::Type type(hdf5::checked(of_object ? H5Aget_type(attribute) : H5Dget_type(object), "type values"));
  const hdf5::Space space(hdf5::checked(of_object ? H5Aget_space(attribute) : H5Dget_space(object), "size values"));
  std::string bytes = zeros_for(type, space);
  if (bytes.empty() || H5Tis_variable_str(type) > 0) return;
  const herr_t read = of_object ? H5Aread(attribute, type, bytes.data())
                                : H5Dread(object, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, bytes.data());
  if (read < 0) return;
  change_one(bytes, H5Tget_size(type), !of_object, random);
  if (of_object)
    H5Awrite(attribute, type, bytes.data());
  else
    H5Dwrite(object, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, bytes.data());
}

void carry_out(const Edit& edit, hid_t file) {
  const auto& targets = sample().targets;
  const Target& target = targets[(edit[1] + 256U * edit[2]) % targets.size()];
  const Target& other = targets[(edit[3] + 256U * edit[4]) % targets.size()];
  const char* object = target.object.c_str();
  switch (edit[0] % 6) {
    case 0:
      if (target.attribute.empty())
        H5Ldelete(file, object, H5P_DEFAULT);
      else
        H5Adelete_by_name(file, object, target.attribute.c_str(), H5P_DEFAULT);
      return;
    case 1:
      if (target.attribute.empty()) {
        H5Ldelete(file, other.object.c_str(), H5P_DEFAULT);
        H5Lmove(file, object, file, other.object.c_str(), H5P_DEFAULT, H5P_DEFAULT);
      } else {
        H5Arename_by_name(file, object, target.attribute.c_str(), other.attribute.c_str(), H5P_DEFAULT);
      }
      return;
    case 2:
      H5Ldelete(file, object, H5P_DEFAULT);
      H5Lcreate_soft(("/" + other.object).c_str(), file, object, H5P_DEFAULT, H5P_DEFAULT);
      return;
    case 3:
      return replace(file, target, edit);
    default:
      return overwrite(file, target, edit);
  }
}

std::vector<std::byte> edited(const std::uint8_t* data, std::size_t size) {
  const hdf5::Quiet quiet;
  std::vector<std::byte> bytes;
  {
    const hdf5::File file = open_to_write(sample().image);
    for (std::size_t i = 0; i < kMostEdits && (i + 1) * kEditBytes <= size; ++i) {
      Edit edit{};
      std::memcpy(edit.data(), data + i * kEditBytes, kEditBytes);
      try {
        carry_out(edit, file);
      } catch (const hdf5::Error&) {
        // HDF5 refused a call of this edit, for instance because an earlier edit removed the object. The loop goes on.
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
  server->ask(support::ServiceHarness::in_session(wire::AcceptNodes{fuzz::kSampleTransfer}, 1, 6));
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
