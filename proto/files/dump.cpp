#include "proto/files/dump.hpp"

#include <sys/stat.h>

#include <algorithm>
#include <system_error>
#include <utility>

#include "proto/files/recording_hdf5.hpp"

namespace shearbus::files {

using namespace hdf5;

namespace {

// HDF5 groups, one for each kind of value.
constexpr const char* kNumbers = "numbers";
constexpr const char* kCounts = "counts";
constexpr const char* kTexts = "texts";

}  // namespace

struct DumpWriter::Impl {
  OutputHdf5 out;

  void write(const char* kind, const std::string& name, hid_t type, const void* values, hsize_t size) const {
    in_file(out.file(), [&] {
      const Properties creation(checked(H5Pcreate(H5P_DATASET_CREATE), "make a property list"));
      if (size > 0) {
        constexpr hsize_t kMostInChunk = hsize_t{1} << 20;
        const hsize_t chunk = std::min(size, kMostInChunk);
        checked(H5Pset_chunk(creation, 1, &chunk), "set chunks");
        checked(H5Pset_fletcher32(creation), "set fletcher32");
      }
      const Dataset dataset = make_dataset(out, fmt::format("/{}/{}", kind, name), type, {size}, creation);
      if (size > 0) hdf5::write(dataset, type, values);
    });
  }
};

DumpWriter::DumpWriter(const std::filesystem::path& file)
    : impl_(new Impl{OutputHdf5(file, kHdf5File, S_IRUSR | S_IWUSR)}) {}
DumpWriter::~DumpWriter() = default;

void DumpWriter::numbers(const std::string& name, std::span<const double> values) {
  impl_->write(kNumbers, name, H5T_IEEE_F64LE, values.data(), values.size());
}
void DumpWriter::counts(const std::string& name, std::span<const std::uint64_t> values) {
  impl_->write(kCounts, name, H5T_STD_U64LE, values.data(), values.size());
}
void DumpWriter::text(const std::string& name, std::string_view value) {
  impl_->write(kTexts, name, H5T_STD_U8LE, value.data(), value.size());
}

void DumpWriter::close() {
  in_file(impl_->out.file(), [&] { impl_->out.close_and_publish(); });
}

namespace {

// Fills `into` with the values of every dataset of a group, by their path in the group.
template <typename Values>
void read_group(hid_t file, const char* kind, hid_t type, std::map<std::string, Values>& into) {
  const Group group = open_group(file, kind);
  std::vector<std::string> names;
  checked(H5Ovisit2(
              group, H5_INDEX_NAME, H5_ITER_INC,
              [](hid_t, const char* name, const H5O_info_t* info, void* out) -> herr_t {
                if (info->type == H5O_TYPE_DATASET) static_cast<std::vector<std::string>*>(out)->emplace_back(name);
                return 0;
              },
              &names, H5O_INFO_BASIC),
          "list the datasets of ", kind);
  for (const std::string& name : names) {
    const Dataset dataset = open_dataset(group, name);
    Values& values = into[name];
    values.resize(count_of(dataset));
    if (!values.empty()) hdf5::read(dataset, type, values.data());
  }
}

template <typename T>
void fill_from(const std::vector<T>& found, const std::string& name, std::span<T> values,
               const std::filesystem::path& file) {
  if (found.size() != values.size())
    refuse_file(file, fmt::format("{} has {} values, expected {}", name, found.size(), values.size()),
                "It is a dump of another scene, or of another version of the program.", name);
  std::ranges::copy(found, values.begin());
}

template <typename Map>
const typename Map::mapped_type& find(const Map& map, const std::string& name, const std::filesystem::path& file) {
  const auto found = map.find(name);
  if (found == map.end()) refuse_file(file, fmt::format("{} is missing", name), "It is no dump of this program.", name);
  return found->second;
}

}  // namespace

DumpReader::DumpReader(std::filesystem::path file) : file_(std::move(file)) {
  in_file(file_, "Is it a restart dump of this program, and whole?", [&] {
    const File hdf(checked(H5Fopen(file_.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), "open it"));
    read_group(hdf, kNumbers, H5T_NATIVE_DOUBLE, numbers_);
    read_group(hdf, kCounts, H5T_NATIVE_UINT64, counts_);
    read_group(hdf, kTexts, H5T_NATIVE_UINT8, texts_);
  });
}

const std::vector<double>& DumpReader::numbers(const std::string& name) const {
  return find(numbers_, name, file_);
}
const std::vector<std::uint64_t>& DumpReader::counts(const std::string& name) const {
  return find(counts_, name, file_);
}
const std::string& DumpReader::text(const std::string& name) const {
  return find(texts_, name, file_);
}
void DumpReader::fill(const std::string& name, std::span<double> values) const {
  fill_from(numbers(name), name, values, file_);
}
void DumpReader::fill(const std::string& name, std::span<std::uint64_t> values) const {
  fill_from(counts(name), name, values, file_);
}

}  // namespace shearbus::files
