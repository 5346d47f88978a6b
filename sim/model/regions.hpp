// Regions of a body: sets of tets, and the vertices that belong to each with the mass of its tets.
#pragma once

#include <span>

#include "sim/model/model.hpp"

namespace viscera::sim {

struct RegionMember {
  int vertex;
  double mass;       // of the region's tets, kg
  double share;      // mass over the vertex's mass in all regions
  Vec3<double> arm;  // r, from the region's centre of mass at rest, m
};

struct Region {
  int begin, end;        // of its members
  double mass = 0.0;     // kg
  Mat3<double> inertia;  // sum m r r^T, kg m2
  double shear = 0.0;    // sum mu V of its tets, J
};

struct Regions {
  std::vector<RegionMember> members;  // region after region, vertices ascending
  std::vector<Region> regions;
  std::vector<int> of_vertex;  // numbers of members, vertex after vertex
  std::vector<int> begin;      // [vertices + 1] into of_vertex

  // `region_of` numbers the region of each tet.
  Regions(const Model& model, std::span<const int> region_of);
  bool has_members_of(const Regions& other) const;
};

}  // namespace viscera::sim
