#include "heap.hpp"

#include <cstdlib>

namespace stereopsis {

void keep_freed_memory() {
#if defined(__GLIBC__)
  // The largest that counts, but for what malloc adds. Not a `new` and `delete`, which a compiler may leave out as a pair.
  void* volatile block = std::malloc((size_t{32} << 20) - (size_t{64} << 10));
  std::free(block);
#endif
}

}  // namespace stereopsis
