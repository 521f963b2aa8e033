#include "dio/video.h"

#include <errno.h>
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/opt.h>
#include <libswscale/swscale.h>
#include <stdlib.h>
#include <string.h>

#include "dio/atomic_file.h"

/* The same number everywhere: x264's bits depend on it. */
#define ENCODER_THREADS 2
#define H264_CRF        "18"
#define MPEG4_QSCALE    3
/* MPEG-4 part 2 stores the clock in 16 bits. */
#define CLOCK_MAX 60000

struct dio_video {
	char *path;
	struct dio_atomic_file *file;
	AVFormatContext *muxer;
	AVCodecContext *encoder;
	AVStream *stream;
	AVFrame *frame;
	AVPacket *packet;
	struct SwsContext *scaler;
	struct dio_picture padded; /* only when a side is odd */
	uint32_t width, height;    /* as the caller's pictures have them */
	int64_t count;
	enum dio_status failed; /* the first failure: the file is not kept */
};

static enum dio_status fail_av(struct dio_video *video, int code, const char *what,
			       struct dio_error *error)
{
	char text[AV_ERROR_MAX_STRING_SIZE] = "";
	enum dio_status status = dio_status_from_errno(AVUNERROR(code));

	av_strerror(code, text, sizeof(text));
	if (status == DIO_NO_SPACE)
		dio_fail(error, status, "%s: the disk is full; free some space and try again",
			 video->path);
	else
		dio_fail(error, status, "%s: cannot %s: %s", video->path, what, text);
	video->failed = status;
	return status;
}

static enum dio_status fail_memory(struct dio_video *video, struct dio_error *error)
{
	video->failed = DIO_NO_MEM;
	return dio_fail(error, DIO_NO_MEM, "%s: no memory for a video of %ux%u", video->path,
			video->width, video->height);
}

/* Accepts a video at any stage of its opening. */
static void release(struct dio_video *video)
{
	sws_freeContext(video->scaler);
	av_packet_free(&video->packet);
	av_frame_free(&video->frame);
	avcodec_free_context(&video->encoder);
	if (video->muxer)
		avio_closep(&video->muxer->pb);
	avformat_free_context(video->muxer);
	dio_picture_deinit(&video->padded);
	dio_atomic_file_discard(video->file);
	free(video->path);
	free(video);
}

static int open_encoder(struct dio_video *video, const char *name, double frames_per_second)
{
	const AVCodec *codec = avcodec_find_encoder_by_name(name);
	AVRational rate = av_d2q(frames_per_second, CLOCK_MAX);
	AVCodecContext *encoder;
	int code;

	if (!codec)
		return AVERROR_ENCODER_NOT_FOUND;
	encoder = avcodec_alloc_context3(codec);
	if (!encoder)
		return AVERROR(ENOMEM);
	encoder->width = (int)(video->width + video->width % 2);
	encoder->height = (int)(video->height + video->height % 2);
	encoder->pix_fmt = AV_PIX_FMT_YUV420P;
	encoder->framerate = rate;
	encoder->time_base = av_inv_q(rate);
	encoder->gop_size = 30;
	encoder->thread_count = ENCODER_THREADS;
	encoder->colorspace = AVCOL_SPC_SMPTE170M;
	encoder->color_range = AVCOL_RANGE_MPEG;
	encoder->color_primaries = AVCOL_PRI_BT709;
	encoder->color_trc = AVCOL_TRC_IEC61966_2_1;
	if (video->muxer->oformat->flags & AVFMT_GLOBALHEADER)
		encoder->flags |= AV_CODEC_FLAG_GLOBAL_HEADER;
	if (codec->id == AV_CODEC_ID_H264) {
		/* An encoder without such an option keeps its own default. */
		av_opt_set(encoder->priv_data, "crf", H264_CRF, 0);
		encoder->bit_rate = 0;
	} else {
		encoder->flags |= AV_CODEC_FLAG_QSCALE;
		encoder->global_quality = MPEG4_QSCALE * FF_QP2LAMBDA;
	}
	code = avcodec_open2(encoder, codec, NULL);
	if (code < 0)
		avcodec_free_context(&encoder);
	else
		video->encoder = encoder;
	return code;
}

/* H.264 when this libav has an encoder for it, else MPEG-4, which it always has. */
static enum dio_status choose_encoder(struct dio_video *video, double frames_per_second,
				      struct dio_error *error)
{
	static const char *const names[] = {"libx264", "libopenh264", "mpeg4"};
	int code = 0;

	for (size_t i = 0; i < sizeof(names) / sizeof(names[0]); i++) {
		code = open_encoder(video, names[i], frames_per_second);
		if (code >= 0)
			return DIO_OK;
	}
	return fail_av(video, code, "encode video", error);
}

static enum dio_status open_stream(struct dio_video *video, struct dio_error *error)
{
	AVDictionary *settings = NULL;
	int code;

	video->stream = avformat_new_stream(video->muxer, NULL);
	if (!video->stream)
		return fail_memory(video, error);
	video->stream->time_base = video->encoder->time_base;
	video->stream->avg_frame_rate = video->encoder->framerate;
	code = avcodec_parameters_from_context(video->stream->codecpar, video->encoder);
	if (code >= 0)
		code = avio_open(&video->muxer->pb, video->muxer->url, AVIO_FLAG_WRITE);
	/* The index at the front, so that players can start before all is loaded. */
	if (code >= 0)
		code = av_dict_set(&settings, "movflags", "+faststart", 0);
	if (code >= 0)
		code = avformat_write_header(video->muxer, &settings);
	av_dict_free(&settings);
	return code < 0 ? fail_av(video, code, "write", error) : DIO_OK;
}

static enum dio_status open_muxer(struct dio_video *video, double frames_per_second,
				  struct dio_error *error)
{
	enum dio_status status;
	char *url;

	/* "file:", so that a colon in the name is not taken for a protocol. */
	if (asprintf(&url, "file:%s", dio_atomic_file_part_path(video->file)) < 0)
		return fail_memory(video, error);
	avformat_alloc_output_context2(&video->muxer, NULL, "mp4", url);
	free(url);
	if (!video->muxer)
		return fail_memory(video, error);
	status = choose_encoder(video, frames_per_second, error);
	return status == DIO_OK ? open_stream(video, error) : status;
}

static enum dio_status make_frame(struct dio_video *video, struct dio_error *error)
{
	const AVCodecContext *encoder = video->encoder;

	video->packet = av_packet_alloc();
	video->frame = av_frame_alloc();
	if (!video->packet || !video->frame)
		return fail_memory(video, error);
	video->frame->format = encoder->pix_fmt;
	video->frame->width = encoder->width;
	video->frame->height = encoder->height;
	if (av_frame_get_buffer(video->frame, 0) < 0)
		return fail_memory(video, error);
	video->scaler = sws_getContext(
		encoder->width, encoder->height, AV_PIX_FMT_RGB24, encoder->width, encoder->height,
		encoder->pix_fmt, SWS_BICUBIC | SWS_ACCURATE_RND | SWS_BITEXACT, NULL, NULL, NULL);
	if (!video->scaler)
		return fail_memory(video, error);
	if ((video->width % 2 || video->height % 2) &&
	    dio_picture_init(&video->padded, (uint32_t)encoder->width, (uint32_t)encoder->height) !=
		    DIO_OK)
		return fail_memory(video, error);
	return DIO_OK;
}

enum dio_status dio_video_open(const char *path, uint32_t width, uint32_t height,
			       double frames_per_second, struct dio_video **video,
			       struct dio_error *error)
{
	struct dio_video *made;
	enum dio_status status;

	if (width < 2 || height < 2 || width > 16384 || height > 16384)
		return dio_fail(error, DIO_BAD_ARG, "%s: a video of %ux%u; sides are 2 to 16384",
				path, width, height);
	if (!(frames_per_second >= 0.1 && frames_per_second <= 1000))
		return dio_fail(error, DIO_BAD_ARG, "%s: %g frames a second; 0.1 to 1000 can be",
				path, frames_per_second);
	made = calloc(1, sizeof(*made));
	if (!made || !(made->path = strdup(path))) {
		free(made);
		return dio_fail(error, DIO_NO_MEM, "%s: out of memory", path);
	}
	/* What goes wrong comes back as an error; encoders need not print their statistics too. */
	av_log_set_level(AV_LOG_FATAL);
	made->width = width;
	made->height = height;
	status = dio_atomic_file_open(path, &made->file, error);
	if (status == DIO_OK)
		status = open_muxer(made, frames_per_second, error);
	if (status == DIO_OK)
		status = make_frame(made, error);
	if (status != DIO_OK) {
		release(made);
		return status;
	}
	*video = made;
	return DIO_OK;
}

/* Send one frame, or NULL to flush, and write what the encoder has ready. */
static enum dio_status encode(struct dio_video *video, const AVFrame *frame,
			      struct dio_error *error)
{
	int code = avcodec_send_frame(video->encoder, frame);

	if (code < 0)
		return fail_av(video, code, "encode", error);
	for (;;) {
		code = avcodec_receive_packet(video->encoder, video->packet);
		if (code == AVERROR(EAGAIN) || code == AVERROR_EOF)
			return DIO_OK;
		if (code < 0)
			return fail_av(video, code, "encode", error);
		av_packet_rescale_ts(video->packet, video->encoder->time_base,
				     video->stream->time_base);
		video->packet->stream_index = video->stream->index;
		code = av_interleaved_write_frame(video->muxer, video->packet);
		if (code < 0)
			return fail_av(video, code, "write", error);
		/* A full disk shows up in the buffered stream first. */
		if (video->muxer->pb->error < 0)
			return fail_av(video, video->muxer->pb->error, "write", error);
	}
}

/* Repeat the last column and row until both sides are even. */
static const uint8_t *pad(struct dio_video *video, const struct dio_picture *picture)
{
	const struct dio_picture *padded = &video->padded;
	const size_t from = 3 * (size_t)picture->width, to = 3 * (size_t)padded->width;

	if (!padded->rgb)
		return picture->rgb;
	for (size_t y = 0; y < padded->height; y++) {
		const uint8_t *src = picture->rgb + from * (y < picture->height ? y : y - 1);
		uint8_t *dst = padded->rgb + to * y;

		memcpy(dst, src, from);
		if (to > from)
			memcpy(dst + from, src + from - 3, 3);
	}
	return padded->rgb;
}

enum dio_status dio_video_append(struct dio_video *video, const struct dio_picture *picture,
				 struct dio_error *error)
{
	const uint8_t *rgb;
	int pitch;

	if (video->failed != DIO_OK)
		return dio_fail(error, video->failed, "%s: writing failed before", video->path);
	if (!picture->rgb || picture->width != video->width || picture->height != video->height)
		return dio_fail(error, DIO_BAD_ARG, "%s: a picture of %ux%u in a video of %ux%u",
				video->path, picture->width, picture->height, video->width,
				video->height);
	if (av_frame_make_writable(video->frame) < 0)
		return fail_memory(video, error);
	rgb = pad(video, picture);
	pitch = 3 * video->encoder->width;
	sws_scale(video->scaler, &rgb, &pitch, 0, video->encoder->height, video->frame->data,
		  video->frame->linesize);
	video->frame->pts = video->count++;
	return encode(video, video->frame, error);
}

static enum dio_status finish(struct dio_video *video, struct dio_error *error)
{
	struct dio_atomic_file *file = video->file;
	enum dio_status status;
	int code;

	if (video->failed != DIO_OK)
		return dio_fail(error, video->failed, "%s: not written: an earlier step failed",
				video->path);
	if (video->count == 0)
		return dio_fail(error, DIO_BAD_ARG, "%s: not written: a video without pictures",
				video->path);
	status = encode(video, NULL, error);
	if (status != DIO_OK)
		return status;
	code = av_write_trailer(video->muxer);
	if (code >= 0)
		code = avio_closep(&video->muxer->pb);
	if (code < 0)
		return fail_av(video, code, "write", error);
	video->file = NULL;
	return dio_atomic_file_commit(file, error);
}

enum dio_status dio_video_close(struct dio_video *video, struct dio_error *error)
{
	enum dio_status status;

	if (!video)
		return DIO_OK;
	status = finish(video, error);
	release(video);
	return status;
}

void dio_video_discard(struct dio_video *video)
{
	if (video)
		release(video);
}
