// What the system's allocator does with memory that was freed.
#pragma once

namespace stereopsis {

// glibc gives the heap's end back to the system once twice as much is free there as the largest block had that was mapped on
// its own and freed. What a match worked in, some 20 MB, would come back page by page in the next one, at a tenth of its time.
// So one such block is taken once, untouched, and freed: from then on a process keeps up to 64 MB. Whoever sets these
// thresholds otherwise (mallopt, GLIBC_TUNABLES) has them as set.
void keep_freed_memory();

}  // namespace stereopsis
