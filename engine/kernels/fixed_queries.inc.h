/* Template: queries of all rows and heads by the tier's query(). */

static void queries(const struct dvsm_fixed_queries *job)
{
	for (size_t i = 0; i < job->rows; i++) {
		for (size_t h = 0; h < job->heads; h++) {
			size_t at = i * job->heads + h;
			int8_t *q = job->q + at * job->head_width;

			query(job->u + i * job->u_stride + h * job->dim, job->dim, &job->gains[h],
			      q, &job->q_scale[at]);
			memset(q + job->dim, 0, job->head_width - job->dim);
		}
	}
}
