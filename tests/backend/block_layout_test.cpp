// How a run is laid out in blocks: which elements, vertices and tets each has, and where they lie.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <numeric>
#include <random>
#include <set>

#include "sim/backend/block_step.hpp"
#include "sim/element_choice.hpp"
#include "tests/sim/shapes.hpp"

namespace viscera::sim {
namespace {

constexpr int tets_per_block = 60;

void expect_phases_of(int lanes, int max_in_color) {
  SCOPED_TRACE(lanes);
  const Model model = make_cube(5);
  const Program<double> program(model, elastic_scene());
  constexpr int max_elements = 6;
  const BlockLayout layout(model, program, tets_per_block, {lanes, max_elements, max_in_color});
  const auto elements =
      layout.lay_out(std::get<Effects::index_of<NeoHookean>()>(program.effects)[0], program, true);
  std::vector<int> seen(model.tet_count());
  for (const int e : elements.element_of) ++seen[e];
  EXPECT_EQ(seen, std::vector<int>(model.tet_count(), 1));
  for (int block = 0; block < layout.block_count(); ++block) {
    const int replicas = layout.replicas_in(block).end - layout.replicas_in(block).begin;
    std::vector<int> met(replicas), vertex_of(replicas, -1);
    for (int i = layout.locals_in(block).begin; i < layout.locals_in(block).end; ++i) {
      const LocalVertex& local = layout.locals()[i];
      for (int c = local.replicas.begin; c < local.replicas.end; ++c)
        vertex_of.at(c) = local.vertex;
    }
    const Range phases = elements.phases_of(block);
    for (int p = phases.begin; p < phases.end; ++p) {
      std::set<int> in_phase;
      const int begin = elements.phase_begin[p], end = elements.phase_begin[p + 1];
      EXPECT_LE(end - begin, lanes);
      for (int e = begin; e < end; ++e) {
        for (int i = 0; i < 4; ++i) {
          const int replica = elements.vertices[e][i];
          EXPECT_TRUE(in_phase.insert(replica).second);
          EXPECT_LE(++met[replica], max_elements);
          EXPECT_EQ(vertex_of.at(replica),
                    model.tets[elements.element_of[e]][elements.roles[e][i]]);
        }
      }
    }
  }
}

TEST(BlockLayout, EveryElementOnceAndNoVertexTwiceInAPhase) {
  expect_phases_of(8, 8);
  expect_phases_of(3, 8);  // colours wider than the lanes are cut
}

// Two bodies that differ in E have all planes in common but the one that E is in.
TEST(Planes, HoldEveryItemAndKeepApartWhatTwoModelsDoNotShare) {
  using Item = AlignedRest<NeoHookean::Rest<float>>;
  Model model = make_cube(2);
  std::array<std::vector<Item>, 2> items;
  std::array<Planes<Item>, 2> planes;
  for (int k = 0; k < 2; ++k) {
    const Program<float> program(model, elastic_scene());
    for (const auto& rest : std::get<Effects::index_of<NeoHookean>()>(program.effects)[0].rest) {
      items[k].push_back({rest});
    }
    planes[k] = planes_of(items[k]);
    PlanesView<Item> view;
    for (std::size_t p = 0; p < planes[k].size(); ++p) view.planes[p] = planes[k][p].data();
    for (std::size_t e = 0; e < items[k].size(); ++e) {
      const Item item = view[static_cast<int>(e)], later = view.from(1)[static_cast<int>(e) - 1];
      EXPECT_EQ(std::memcmp(&item, &items[k][e], sizeof(Item)), 0);
      EXPECT_EQ(std::memcmp(&later, &items[k][e], sizeof(Item)), 0);
    }
    for (Material& material : model.materials) material.youngs_modulus *= 2.0;
  }
  EXPECT_EQ(planes[0][0], planes[1][0]);
  EXPECT_EQ(planes[0][1], planes[1][1]);
  EXPECT_NE(planes[0][2], planes[1][2]);
}

// How long a group's loads take, one role after the other: as many turns as the fullest bank has
// rows.
int turns_of(std::span<const std::array<int, 4>> group) {
  int turns = 0;
  for (int i = 0; i < 4; ++i) {
    std::array<int, 8> wanted{};
    for (const auto& rows : group) ++wanted[rows[i] % 8];
    turns += *std::ranges::max_element(wanted);
  }
  return turns;
}

// Eight lanes that want four rows of every bank, in some order: four turns are enough.
TEST(Banks, LanesWaitForNoOtherWhereTheyNeedNot) {
  std::mt19937 random(7);
  for (int trial = 0; trial < 200; ++trial) {
    std::vector<int> rows(32);
    std::iota(rows.begin(), rows.end(), 0);
    std::ranges::shuffle(rows, random);
    std::vector<std::array<int, 4>> group(8);
    for (int k = 0; k < 32; ++k) group[k / 4][k % 4] = rows[k];
    const std::vector<int> order = {0, 1, 2, 3, 4, 5, 6, 7};
    std::vector<Roles<4>> roles(8);
    Banks<4>(group, 8).share_out(order, roles);
    std::vector<std::array<int, 4>> in_turns(8);
    for (int lane = 0; lane < 8; ++lane) {
      EXPECT_TRUE(std::ranges::is_permutation(roles[lane], in_order<4>()));
      for (int i = 0; i < 4; ++i) in_turns[lane][i] = group[lane][roles[lane][i]];
    }
    EXPECT_EQ(turns_of(in_turns), 4);
  }
}

// Random elements take twice as many turns as they must; chosen and counted for it, 1.3 times.
TEST(Banks, ElementsThatLoadAtOnceWantRowsOfAllBanks) {
  std::mt19937 random(7);
  std::vector<std::array<int, 4>> elements(128);
  for (auto& rows : elements) {
    for (int& row : rows) row = static_cast<int>(random() % 1024);
  }
  std::vector<int> order(elements.size());
  std::iota(order.begin(), order.end(), 0);
  const std::vector<int> all = order;
  const Banks<4> banks(elements, 8);
  banks.balance(order);
  std::vector<Roles<4>> roles(order.size());
  banks.share_out(order, roles);
  int turns = 0, before = 0;
  for (std::size_t at = 0; at < order.size(); at += 8) {
    std::array<std::array<int, 4>, 8> group;
    for (int lane = 0; lane < 8; ++lane) {
      for (int i = 0; i < 4; ++i) {
        group[lane][i] = elements[order[at + lane]][roles[at + lane][i]];
      }
    }
    turns += turns_of(group);
    before += turns_of(std::span(elements).subspan(at, 8));
  }
  EXPECT_TRUE(std::ranges::is_permutation(order, all));
  EXPECT_LE(turns, 1.3 * 4 * 16);
  EXPECT_GE(before, 2.0 * 4 * 16);
}

TEST(BlockLayout, AVertexWithoutElementsHasAReplica) {
  const Model model = make_cube(3);
  const Program<double> program(model, particle_scene());
  const BlockLayout layout(model, program, tets_per_block, {32, 16});
  EXPECT_EQ(layout.locals().size(), model.vertex_count());
}

// Of linear tets and of smoothed ones, whose domains a block has whole.
TEST(BlockLayout, EveryTetIsInOneBlockThatTouchesAllOfItsVertices) {
  const Model model = make_cube(5);
  for (const Element element : {Element::linear, Element::smoothed}) {
    Scene scene = elastic_scene();
    set_element(scene.effects, element, soft_tissue.poisson_ratio);
    const Program<double> program(model, scene);
    const BlockLayout layout(model, program, tets_per_block, team_for(tets_per_block, 625));
    const BlockTets in_blocks = layout.tets_in_blocks(model.tets);
    ASSERT_EQ(static_cast<int>(in_blocks.begin.size()), layout.block_count() + 1);
    EXPECT_GT(layout.block_count(), 5);
    std::set<int> found;
    for (int block = 0; block < layout.block_count(); ++block) {
      const Range locals = layout.locals_in(block);
      for (int at = in_blocks.begin[block]; at < in_blocks.begin[block + 1]; ++at) {
        const int t = in_blocks.tets[at];
        EXPECT_TRUE(found.insert(t).second) << "tet " << t << " is there twice";
        for (int i = 0; i < 4; ++i) {
          const int local = locals.begin + in_blocks.corners[at][i];
          ASSERT_LT(local, locals.end);
          EXPECT_EQ(layout.locals()[local].vertex, model.tets[t][i]);
        }
      }
    }
    EXPECT_EQ(found.size(), model.tet_count());
  }
}

}  // namespace
}  // namespace viscera::sim
