// Stand-in for pdqsort, which VAMP's headers need and few systems have: sorts obstacles once per scene.
#pragma once
#include <algorithm>

template <typename Iterator, typename Compare>
inline void pdqsort(Iterator begin, Iterator end, Compare compare)
{
    std::sort(begin, end, compare);
}

template <typename Iterator, typename Compare>
inline void pdqsort_branchless(Iterator begin, Iterator end, Compare compare)
{
    std::sort(begin, end, compare);
}
