// Stand-in for nigh, the nearest neighbors of VAMP's trees, as far as its RRT-Connect needs them: exact neighbors from a k-d tree whose
// leaves have up to `batch` nodes, which is nigh's method and VAMP's setting.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

namespace unc::robotics::nigh
{
    namespace metric
    {
        template <int>
        struct LP
        {
        };

        template <typename Type, typename Metric>
        struct Space;
    }  // namespace metric

    struct NoThreadSafety
    {
    };

    template <std::size_t batch>
    struct KDTreeBatch
    {
        static constexpr std::size_t size = batch;
    };

    template <typename T, typename Space, typename Key, typename Safety, typename Strategy>
    class Nigh
    {
        static constexpr int n = Space::kDimensions;
        using Bounds = std::array<std::array<float, n>, 2>;

        struct Branch
        {
            std::array<std::size_t, 2> halves{0, 0};  // 0: a leaf
            Bounds bounds;
            std::vector<T> nodes;
        };

        std::vector<Branch> branches;
        std::size_t count = 0;

        static Branch empty()
        {
            Branch branch;
            branch.bounds[0].fill(std::numeric_limits<float>::infinity());
            branch.bounds[1].fill(-std::numeric_limits<float>::infinity());
            return branch;
        }

        static float at(const T &node, int axis)
        {
            return Space::coeff(Key()(node), static_cast<std::size_t>(axis));
        }

        static void put(Branch &branch, const T &node)
        {
            widen(branch, node);
            branch.nodes.push_back(node);
        }

        static void widen(Branch &branch, const T &node)
        {
            for (int i = 0; i < n; ++i)
            {
                branch.bounds[0][i] = std::min(branch.bounds[0][i], at(node, i));
                branch.bounds[1][i] = std::max(branch.bounds[1][i], at(node, i));
            }
        }

        template <typename K>
        static float beyond(const Branch &branch, const K &key)
        {
            float squared = 0;
            for (int i = 0; i < n; ++i)
            {
                const float x = Space::coeff(key, static_cast<std::size_t>(i));
                const float over = std::max({branch.bounds[0][i] - x, x - branch.bounds[1][i], 0.F});
                squared += over * over;
            }
            return squared;
        }

        void split(std::size_t leaf)
        {
            int wide = 0;
            const auto width = [&](int i) { return branches[leaf].bounds[1][i] - branches[leaf].bounds[0][i]; };
            for (int i = 1; i < n; ++i)
                if (width(i) > width(wide))
                    wide = i;
            auto nodes = std::move(branches[leaf].nodes);
            branches[leaf].nodes.clear();
            const auto middle = nodes.begin() + static_cast<std::ptrdiff_t>(nodes.size() / 2);
            std::nth_element(
                nodes.begin(), middle, nodes.end(), [&](const T &a, const T &b) { return at(a, wide) < at(b, wide); });
            Branch low = empty(), high = empty();
            std::for_each(nodes.begin(), middle, [&](const T &node) { put(low, node); });
            std::for_each(middle, nodes.end(), [&](const T &node) { put(high, node); });
            branches[leaf].halves = {branches.size(), branches.size() + 1};
            branches.push_back(std::move(low));
            branches.push_back(std::move(high));
        }

        template <typename K>
        void search(std::size_t index, const K &key, const T *&best, float &distance) const
        {
            const Branch &branch = branches[index];
            if (branch.halves[0] == 0)
            {
                for (const T &node : branch.nodes)
                {
                    const float far = Space::distance(Key()(node), key);
                    if (far < distance)
                    {
                        distance = far;
                        best = &node;
                    }
                }
                return;
            }
            auto halves = branch.halves;
            std::array<float, 2> squared{beyond(branches[halves[0]], key), beyond(branches[halves[1]], key)};
            if (squared[1] < squared[0])
            {
                std::swap(halves[0], halves[1]);
                std::swap(squared[0], squared[1]);
            }
            for (std::size_t i = 0; i < 2; ++i)
                if (squared[i] < distance * distance)
                    search(halves[i], key, best, distance);
        }

    public:
        [[nodiscard]] std::size_t size() const
        {
            return count;
        }

        void insert(const T &node)
        {
            if (branches.empty())
                branches.push_back(empty());
            ++count;
            std::size_t index = 0;
            while (branches[index].halves[0] != 0)
            {
                widen(branches[index], node);
                const auto &halves = branches[index].halves;
                index = beyond(branches[halves[1]], Key()(node)) < beyond(branches[halves[0]], Key()(node)) ?
                            halves[1] :
                            halves[0];
            }
            put(branches[index], node);
            if (branches[index].nodes.size() > Strategy::size)
                split(index);
        }

        template <typename K>
        [[nodiscard]] std::optional<std::pair<T, float>> nearest(const K &key) const
        {
            if (count == 0)
                return std::nullopt;
            const T *best = nullptr;
            float distance = std::numeric_limits<float>::infinity();
            search(0, key, best, distance);
            if (best == nullptr)
                return std::nullopt;
            return std::make_pair(*best, distance);
        }
    };
}  // namespace unc::robotics::nigh
