#include "stages/trajectory/xdmf.hpp"

#include <fmt/format.h>

namespace viscera {

std::string xdmf(std::size_t points, std::size_t tets, const std::vector<double>& times_s,
                 const std::string& cell_file, const std::vector<std::string>& fields) {
  std::string text = R"(<?xml version="1.0" ?>
<Xdmf Version="2.0">
 <Domain>
  <Grid Name="trajectory" GridType="Collection" CollectionType="Temporal">
)";
  for (std::size_t frame = 0; frame < times_s.size(); ++frame) {
    text += fmt::format(R"(   <Grid Name="frame {0}" GridType="Uniform">
    <Time Value="{1}"/>
    <Topology TopologyType="Tetrahedron" NumberOfElements="{3}">
     <DataItem Format="HDF" NumberType="Int" Precision="4" Dimensions="{3} 4">{4}:/tets</DataItem>
    </Topology>
    <Geometry GeometryType="XYZ">
     <DataItem Format="HDF" NumberType="Float" Precision="4" Dimensions="{2} 3">{4}:/frames/{0}</DataItem>
    </Geometry>
    <Attribute Name="label" AttributeType="Scalar" Center="Cell">
     <DataItem Format="HDF" NumberType="Int" Precision="4" Dimensions="{3}">{4}:/labels</DataItem>
    </Attribute>
)",
                        frame, times_s[frame], points, tets, trajectory_name);
    for (const std::string& field : fields) {
      text += fmt::format(R"(    <Attribute Name="{0}" AttributeType="Scalar" Center="Cell">
     <DataItem Format="HDF" NumberType="Float" Precision="4" Dimensions="{2}">{1}:/{0}/{3}</DataItem>
    </Attribute>
)",
                          field, cell_file, tets, frame);
    }
    text += "   </Grid>\n";
  }
  return text + "  </Grid>\n </Domain>\n</Xdmf>\n";
}

}  // namespace viscera
