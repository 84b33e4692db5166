#include "proto/wire/fields.hpp"

#include <array>
#include <fstream>
#include <system_error>

#include "proto/wire/recording_hdf5.hpp"

namespace shearbus::wire {

using namespace hdf5;

struct FieldWriter::Impl {
  std::filesystem::path file;
  std::filesystem::path partial;
  std::size_t nodes = 0;
  std::size_t zones = 0;
  std::vector<Quantity> quantities;
  File hdf;
  std::vector<double> times;

  ~Impl() {
    if (hdf < 0) return;
    hdf.close();
    std::error_code ignored;
    std::filesystem::remove(partial, ignored);
  }

  void attribute(hid_t of, const char* name, const std::string& text) {
    const Type type(checked(H5Tcopy(H5T_C_S1), file, "cannot make a text type"));
    checked(H5Tset_size(type, text.size() + 1), file, "cannot size a text");
    const Space space(checked(H5Screate(H5S_SCALAR), file, "cannot make a scalar"));
    const Attribute attribute(
        checked(H5Acreate2(of, name, type, space, H5P_DEFAULT, H5P_DEFAULT), file, "cannot make an attribute"));
    checked(H5Awrite(attribute, type, text.c_str()), file, "cannot write an attribute");
  }

  template <std::size_t kRank>
  Dataset dataset(const std::string& name, const std::array<hsize_t, kRank>& shape, hid_t file_type, hid_t memory_type,
                  const void* values) {
    const Space space(checked(H5Screate_simple(kRank, shape.data(), nullptr), file, "cannot make a shape"));
    Dataset made(checked(H5Dcreate2(hdf, name.c_str(), file_type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), file,
                         "cannot make a dataset"));
    checked(H5Dwrite(made, memory_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values), file, "cannot write a dataset");
    return made;
  }

  std::string item(const std::string& path, const std::string& shape, const char* type, int precision) const {
    return fmt::format(R"(<DataItem Format="HDF" NumberType="{}" Precision="{}" Dimensions="{}">{}:{}</DataItem>)",
                       type, precision, shape, file.filename().string(), path);
  }

  std::string xdmf() const {
    const std::string vectors = fmt::format("{} 3", nodes);
    std::string text =
        "<?xml version=\"1.0\"?>\n<Xdmf Version=\"3.0\">\n<Domain>\n"
        "<Grid Name=\"fields\" GridType=\"Collection\" CollectionType=\"Temporal\">\n";
    for (std::size_t frame = 0; frame < times.size(); ++frame) {
      const std::string group = fmt::format("/frame/{:05}", frame);
      text += fmt::format(
          "<Grid Name=\"frame {0}\" GridType=\"Uniform\">\n<Time Value=\"{1:.17g}\"/>\n"
          "<Topology TopologyType=\"Quadrilateral\" NumberOfElements=\"{2}\">{3}</Topology>\n"
          "<Geometry GeometryType=\"XYZ\">{4}</Geometry>\n"
          "<Attribute Name=\"velocity\" AttributeType=\"Vector\" Center=\"Node\">{5}</Attribute>\n",
          frame, times[frame], zones, item("/quads", fmt::format("{} 4", zones), "Int", 4),
          item(group + "/place", vectors, "Float", 8), item(group + "/velocity", vectors, "Float", 8));
      for (const Quantity& quantity : quantities) {
        text += fmt::format("<Attribute Name=\"{}\" AttributeType=\"Scalar\" Center=\"Cell\">{}</Attribute>\n",
                            quantity.name, item(group + "/" + quantity.name, std::to_string(zones), "Float", 8));
      }
      text += "</Grid>\n";
    }
    return text + "</Grid>\n</Domain>\n</Xdmf>\n";
  }
};

FieldWriter::FieldWriter(std::filesystem::path file, std::span<const std::int32_t> quads, std::size_t nodes,
                         std::vector<Quantity> zone_quantities, std::string scene)
    : impl_(std::make_unique<Impl>()) {
  const Quiet quiet;
  Impl& w = *impl_;
  w.file = std::move(file);
  w.partial = w.file.string() + ".partial";
  w.nodes = nodes;
  w.zones = quads.size() / 4;
  w.quantities = std::move(zone_quantities);
  const Properties access(checked(H5Pcreate(H5P_FILE_ACCESS), w.file, "cannot set up a file"));
  checked(H5Pset_libver_bounds(access, H5F_LIBVER_V110, H5F_LIBVER_V110), w.file, "cannot set up a file");
  w.hdf = File(checked(H5Fcreate(w.partial.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access), w.file, "cannot create it"));
  w.attribute(w.hdf, "format", "shearbus-fields");
  w.attribute(w.hdf, "units_system", "SI");
  w.dataset<2>("/quads", {w.zones, 4}, H5T_STD_I32LE, H5T_NATIVE_INT32, quads.data());
  const Group frames(
      checked(H5Gcreate2(w.hdf, "/frame", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), w.file, "cannot make a group"));
  const std::array<hsize_t, 1> letters = {scene.size()};
  if (!scene.empty()) w.dataset<1>("/scene", letters, H5T_STD_U8LE, H5T_NATIVE_UINT8, scene.data());
}
FieldWriter::FieldWriter(FieldWriter&&) noexcept = default;
FieldWriter& FieldWriter::operator=(FieldWriter&&) noexcept = default;
FieldWriter::~FieldWriter() = default;

void FieldWriter::frame(double time_s, std::span<const double> place, std::span<const double> velocity,
                        std::span<const std::span<const double>> zones) {
  const Quiet quiet;
  Impl& w = *impl_;
  const std::string group = fmt::format("/frame/{:05}", w.times.size());
  const Group made(
      checked(H5Gcreate2(w.hdf, group.c_str(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), w.file, "cannot make a group"));
  const Dataset placed = w.dataset<2>(group + "/place", {w.nodes, 3}, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, place.data());
  w.attribute(placed, "units", "m");
  const Dataset moved =
      w.dataset<2>(group + "/velocity", {w.nodes, 3}, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, velocity.data());
  w.attribute(moved, "units", "m s-1");
  for (std::size_t q = 0; q < w.quantities.size(); ++q) {
    const Quantity& quantity = w.quantities[q];
    const Dataset values =
        w.dataset<1>(group + "/" + quantity.name, {w.zones}, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, zones[q].data());
    w.attribute(values, "units", quantity.units);
    w.attribute(values, "long_name", quantity.long_name);
  }
  w.times.push_back(time_s);
}

// The sidecar is written last: it names a whole file or is not there.
void FieldWriter::close() {
  const Quiet quiet;
  Impl& w = *impl_;
  const std::array<hsize_t, 1> count = {w.times.size()};
  w.attribute(w.dataset<1>("/time", count, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, w.times.data()), "units", "s");
  checked(w.hdf.close(), w.file, "cannot close it");
  std::filesystem::rename(w.partial, w.file);
  std::filesystem::path sidecar = w.file;
  sidecar.replace_extension(".xmf");
  std::ofstream stream(sidecar, std::ios::binary);
  stream << w.xdmf();
  stream.close();
  if (!stream) throw std::system_error(errno, std::generic_category(), "cannot write " + sidecar.string());
}

}  // namespace shearbus::wire
