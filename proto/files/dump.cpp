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
  PartialFile partial;
  const std::filesystem::path& file;
  File hdf;

  explicit Impl(const std::filesystem::path& name)
      : partial(name, kHdf5File, PartialFile::Writers::kOne, S_IRUSR | S_IWUSR),
        file(partial.file()),
        hdf(create_file(partial)) {}

  void write(const char* kind, const std::string& name, hid_t file_type, hid_t memory_type, const void* values,
             hsize_t size) const {
    const Quiet quiet;
    const Properties creation(checked(H5Pcreate(H5P_DATASET_CREATE), file, "cannot prepare a dataset"));
    if (size > 0) {
      constexpr hsize_t kMostInChunk = hsize_t{1} << 20;
      const hsize_t chunk = std::min(size, kMostInChunk);
      checked(H5Pset_chunk(creation, 1, &chunk), file, "cannot set chunks");
      checked(H5Pset_fletcher32(creation), file, "cannot set fletcher32");
    }
    const Properties link(checked(H5Pcreate(H5P_LINK_CREATE), file, "cannot prepare a dataset"));
    checked(H5Pset_create_intermediate_group(link, 1), file, "cannot prepare a dataset");
    const Space space(checked(H5Screate_simple(1, &size, nullptr), file, "cannot set a size"));
    const std::string path = fmt::format("/{}/{}", kind, name);
    const Dataset dataset(checked(H5Dcreate2(hdf, path.c_str(), file_type, space, link, creation, H5P_DEFAULT), file,
                                  "cannot create a dataset"));
    if (size > 0)
      checked(H5Dwrite(dataset, memory_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values), file, "cannot write a dataset");
  }
};

DumpWriter::DumpWriter(std::filesystem::path file) {
  const Quiet quiet;
  impl_ = std::make_unique<Impl>(file);
}
DumpWriter::~DumpWriter() = default;

void DumpWriter::numbers(const std::string& name, std::span<const double> values) {
  impl_->write(kNumbers, name, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, values.data(), values.size());
}
void DumpWriter::counts(const std::string& name, std::span<const std::uint64_t> values) {
  impl_->write(kCounts, name, H5T_STD_U64LE, H5T_NATIVE_UINT64, values.data(), values.size());
}
void DumpWriter::text(const std::string& name, std::string_view value) {
  impl_->write(kTexts, name, H5T_STD_U8LE, H5T_NATIVE_UINT8, value.data(), value.size());
}

void DumpWriter::close() {
  const Quiet quiet;
  close_and_publish(impl_->hdf, impl_->partial);
}

namespace {

template <typename T>
std::vector<T> read(const Dataset& dataset, hid_t memory_type, const std::filesystem::path& file) {
  const Space space(checked(H5Dget_space(dataset), file, "cannot read a size"));
  std::vector<T> values(
      static_cast<std::size_t>(checked(H5Sget_simple_extent_npoints(space), file, "cannot read a size")));
  if (!values.empty())
    checked(H5Dread(dataset, memory_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()), file, "cannot read a dataset");
  return values;
}

// Returns the datasets inside a group, by their path in the group.
std::vector<std::string> names_below(const Group& group, const std::filesystem::path& file) {
  std::vector<std::string> names;
  checked(H5Ovisit2(
              group, H5_INDEX_NAME, H5_ITER_INC,
              [](hid_t, const char* name, const H5O_info_t* info, void* out) -> herr_t {
                if (info->type == H5O_TYPE_DATASET) static_cast<std::vector<std::string>*>(out)->emplace_back(name);
                return 0;
              },
              &names, H5O_INFO_BASIC),
          file, "cannot list its datasets");
  return names;
}

template <typename T>
void fill_from(const std::vector<T>& found, const std::string& name, std::span<T> values,
               const std::filesystem::path& file) {
  if (found.size() != values.size())
    refuse(file, fmt::format("{} has {} values, expected {}", name, found.size(), values.size()),
           "It is a dump of another scene, or of another version of the program.", name);
  std::ranges::copy(found, values.begin());
}

template <typename Map>
const typename Map::mapped_type& find(const Map& map, const std::string& name, const std::filesystem::path& file) {
  const auto found = map.find(name);
  if (found == map.end()) refuse(file, fmt::format("{} is missing", name), "It is no dump of this program.", name);
  return found->second;
}

}  // namespace

DumpReader::DumpReader(std::filesystem::path file) : file_(std::move(file)) {
  const Quiet quiet;
  const File hdf(checked(H5Fopen(file_.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), file_, "cannot open it"));
  const auto each = [&](const char* kind, const auto& take) {
    const Group group(checked(H5Gopen2(hdf, kind, H5P_DEFAULT), file_, "it is no restart dump"));
    for (const std::string& name : names_below(group, file_))
      take(name, Dataset(checked(H5Dopen2(group, name.c_str(), H5P_DEFAULT), file_, "cannot open a dataset")));
  };
  each(kNumbers, [&](const std::string& name, const Dataset& dataset) {
    numbers_[name] = read<double>(dataset, H5T_NATIVE_DOUBLE, file_);
  });
  each(kCounts, [&](const std::string& name, const Dataset& dataset) {
    counts_[name] = read<std::uint64_t>(dataset, H5T_NATIVE_UINT64, file_);
  });
  each(kTexts, [&](const std::string& name, const Dataset& dataset) {
    const std::vector<std::uint8_t> bytes = read<std::uint8_t>(dataset, H5T_NATIVE_UINT8, file_);
    texts_[name].assign(bytes.begin(), bytes.end());
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
