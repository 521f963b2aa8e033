/* Which posed pictures are worth keeping, and who is context and who is target. */
#ifndef DIO_CAPTURE_POSING_ROLES_H
#define DIO_CAPTURE_POSING_ROLES_H

#include "capture/posing.h"

/** Mark views whose reprojection error is far above the median as outliers; drop their pictures. */
void dio_posing_mark_outliers(struct dio_posing *result);

/** Hand out roles to the posed views, fill in the counts and the mean error. */
void dio_posing_assign_roles(struct dio_posing *result, const struct dio_posing_options *options);

#endif
