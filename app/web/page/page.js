// The page of a box: asks for state and picture, sends what hand and buttons do.
'use strict';

const at = (id) => document.getElementById(id);
const STATUS_MS = 400, PICTURE_MS = 80, NONE_MS = 250, PATIENCE_MS = 1500;

// The token comes behind the address once (#TOKEN) and is kept for this tab.
let token = location.hash.slice(1) || sessionStorage.getItem('token') || '';
let shown = {};
let turn = null;

function remember(value) {
	token = value;
	sessionStorage.setItem('token', value);
	history.replaceState(null, '', location.pathname);
}

async function ask(path, options = {}) {
	const answer = await fetch('/api/' + path, {
		...options, headers: { Authorization: 'Bearer ' + token } });
	if (answer.status === 401) {
		at('login').hidden = false;
		throw new Error('the token is wrong');
	}
	at('login').hidden = true;
	return answer;
}

function say(text, alarm) {
	at('message').textContent = text;
	at('message').classList.toggle('alarm', Boolean(alarm));
}

const HINTS = {
	idle: 'Calibrate once with the printed board, then capture.',
	calibrate: 'Show the board near, far, tilted, and in every corner of the picture. ' +
		'Calibrate again to fit with what there is.',
	capture: 'Walk the camera round the scene. Capture keeps a view now; Reconstruct when there are enough.',
	reconstruct: 'The engine is at work.',
	view: 'Drag to turn, wheel to come nearer. Double click follows the camera again.',
	play: 'Play again to follow the camera.',
};
const NEXT = { idle: 'capture', calibrate: 'calibrate', capture: 'reconstruct', view: 'play', play: 'play' };

function list(facts) {
	at('facts').replaceChildren(...facts.flatMap(([name, value]) => {
		const term = document.createElement('dt'), text = document.createElement('dd');
		term.textContent = name;
		text.textContent = value;
		return [term, text];
	}));
}

function factsOf(status) {
	const facts = [['camera', status.camera], ['calibrated', status.calibrated ? 'yes' : 'no']];
	if (status.state === 'calibrate')
		facts.push(['board views', status.board_views],
			['coverage', Math.round(status.coverage * 100) + ' %']);
	facts.push(['views', `${status.views} of ${status.views_min} to ${status.views_max}`]);
	if (status.state === 'capture') {
		facts.push(['last picture', status.verdict]);
		for (const [reason, count] of Object.entries(status.skipped))
			facts.push(['skipped: ' + reason, count]);
	}
	if (status.scene)
		facts.push(['seen from', status.source], ['render', `${status.render_ms} ms, patch ${status.patch_px}`]);
	return facts;
}

// Where corners of the board were seen so far, over the picture as it is shown.
function drawCells(status) {
	const svg = at('cells'), image = at('picture');
	const visible = status.state === 'calibrate' && image.naturalWidth > 0;
	svg.toggleAttribute('hidden', !visible);
	if (!visible)
		return;
	const scale = Math.min(image.clientWidth / image.naturalWidth, image.clientHeight / image.naturalHeight);
	svg.style.width = image.naturalWidth * scale + 'px';
	svg.style.height = image.naturalHeight * scale + 'px';
	svg.replaceChildren(...status.cells.flatMap((seen, i) => {
		if (!seen)
			return [];
		const cell = document.createElementNS('http://www.w3.org/2000/svg', 'rect');
		for (const [name, value] of Object.entries({ x: i % 8, y: Math.floor(i / 8), width: 1, height: 1 }))
			cell.setAttribute(name, value);
		return [cell];
	}));
}

function drawDownloads(status) {
	at('downloads').hidden = status.views === 0;
	const names = [...Array(status.views).keys()].map((i) => String(i).padStart(3, '0'));
	if (at('images').childElementCount === names.length)
		return;
	at('images').replaceChildren(...names.map((name) => {
		const link = document.createElement('a');
		link.href = '#';
		link.dataset.file = `images/${name}.png`;
		link.textContent = name;
		return link;
	}));
}

function draw(status) {
	shown = status;
	at('state').textContent = status.state;
	at('figures').textContent = `${status.fps} fps, ${status.latency_ms} ms (p99 ${status.latency_p99_ms})`;
	at('hint').textContent = HINTS[status.state] || '';
	at('progress').hidden = status.state !== 'reconstruct';
	at('progress').value = status.progress;
	at('stage').classList.toggle('turns', status.state === 'view' || status.state === 'play');
	for (const button of document.querySelectorAll('button[data-word]'))
		button.classList.toggle('now', button.dataset.word === NEXT[status.state]);
	list(factsOf(status));
	drawCells(status);
	drawDownloads(status);
	if (Date.now() > draw.quietUntil)
		say(status.message, status.alarm);
}
draw.quietUntil = 0;

// What the box refuses is read before the next news covers it.
async function act(word, body) {
	const answer = await ask(word, { method: 'POST', body: body ? JSON.stringify(body) : '' });
	if (!answer.ok) {
		say(await answer.text(), true);
		draw.quietUntil = Date.now() + 4000;
	}
}

async function download(name) {
	const answer = await ask(name);
	if (!answer.ok)
		return say(await answer.text(), true);
	const link = document.createElement('a');
	link.href = URL.createObjectURL(await answer.blob());
	link.download = name.replace('/', '-');
	link.click();
	setTimeout(() => URL.revokeObjectURL(link.href), 60000);
}

const pause = (ms) => new Promise((done) => setTimeout(done, ms));

async function followStatus() {
	for (;;) {
		try {
			draw(await (await ask('status')).json());
			await pause(STATUS_MS);
		} catch (error) {
			at('state').textContent = 'no answer';
			await pause(PATIENCE_MS);
		}
	}
}

async function followPicture() {
	for (;;) {
		try {
			const answer = await ask('picture.jpg');
			at('empty').hidden = answer.ok;
			if (answer.ok) {
				const former = at('picture').src;
				at('picture').src = URL.createObjectURL(await answer.blob());
				await at('picture').decode().catch(() => {});
				URL.revokeObjectURL(former);
			}
			await pause(document.hidden ? PATIENCE_MS : answer.ok ? PICTURE_MS : NONE_MS);
		} catch (error) {
			await pause(PATIENCE_MS);
		}
	}
}

// Movements are summed up while one is on its way.
async function sendTurns() {
	while (turn) {
		const now = turn;
		turn = { azimuth: 0, elevation: 0, notches: 0 };
		await act('turn', now).catch(() => {});
		if (!turn.azimuth && !turn.elevation && !turn.notches)
			turn = null;
	}
}

function addTurn(azimuth, elevation, notches) {
	if (!shown.scene || !at('stage').classList.contains('turns'))
		return;
	const idle = !turn;
	turn = turn || { azimuth: 0, elevation: 0, notches: 0 };
	turn.azimuth += azimuth;
	turn.elevation += elevation;
	turn.notches += notches;
	if (idle)
		sendTurns();
}

at('stage').addEventListener('pointerdown', (event) => at('stage').setPointerCapture(event.pointerId));
at('stage').addEventListener('pointermove', (event) => {
	if (event.buttons & 1)
		addTurn(-event.movementX / at('stage').clientWidth * Math.PI,
			event.movementY / at('stage').clientHeight * Math.PI, 0);
});
at('stage').addEventListener('wheel', (event) => {
	event.preventDefault();
	addTurn(0, 0, -Math.sign(event.deltaY));
}, { passive: false });
at('stage').addEventListener('dblclick', () => act('follow').catch(() => {}));
document.addEventListener('click', (event) => {
	const { word, file } = event.target.dataset || {};
	if (word)
		act(word).catch(() => {});
	if (file) {
		event.preventDefault();
		download(file).catch(() => {});
	}
});
at('login').addEventListener('submit', (event) => {
	event.preventDefault();
	remember(at('token').value.trim());
});

remember(token);
followStatus();
followPicture();
