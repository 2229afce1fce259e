/* Four doubles as one operand: SSE2, AVX, NEON as the target has it, the same bits in each. */
#ifndef AEROMATCH_FOUR_H
#define AEROMATCH_FOUR_H

typedef double four __attribute__((vector_size(32), aligned(8), may_alias));
typedef long long four_counts __attribute__((vector_size(32), aligned(8), may_alias));

#define AT(p) (*(const four *)(p)) /* any address */
#define PUT(p) (*(four *)(p))

#endif
