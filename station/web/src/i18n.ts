// The page's texts in English and Spanish, and numbers and times as the language writes them.

const en = {
  'app.title': 'Baliza station',
  skip: 'Skip to the panel',
  site: 'Site',
  language: 'Language',
  theme: 'Appearance',
  'theme.auto': 'Like the system',
  'theme.light': 'Light',
  'theme.dark': 'Dark',
  login: 'Log in',
  logout: 'Log out',
  'login.title': 'This station asks who you are',
  'login.help': 'Ask the person who runs the station for a token. The session is kept in a cookie of this browser.',
  'login.token': 'Token',
  'login.wrong': 'The station does not know this token.',
  'login.in': 'Sign in',
  'login.or': 'Or with a token:',
  'sign-in.away': 'The provider of sign-ins does not answer. Try again later.',
  'sign-in.unknown': 'That sign-in has ended or took too long. Sign in again.',
  'sign-in.denied': 'The provider has refused the sign-in.',
  'sign-in.distrusted': 'The answer of the provider cannot be trusted. The station’s log says why.',
  'sign-in.no-role': 'You are known, but you have no role at this station. Ask the person who runs it.',
  'sign-in.too-many': 'Too many sign-ins from here. Wait a minute.',
  'state.connecting': 'connecting…',
  'state.live': 'live',
  'state.reconnecting': 'reconnecting…',
  'state.history': 'history',
  cancel: 'Cancel',
  save: 'Save',
  delete: 'Delete',
  really: 'Really delete?',
  close: 'Close',
  name: 'Name',
  failed: 'That failed: {message}',
  saved: 'Saved: {name}',
  deleted: 'Deleted: {name}',
  readonly: 'Your role does not allow this.',
  map: 'Map',
  'map.help':
    'Map of the site. Arrow keys move it, plus and minus zoom, 0 shows all, Enter puts a point at the cross. The tags are in the panel Tags, also as a table.',
  'map.in': 'Zoom in',
  'map.out': 'Zoom out',
  'map.fit': 'Show all',
  'map.layers': 'Shown',
  'layer.plan': 'Plan and walls',
  'layer.zones': 'Rooms and zones',
  'layer.nodes': 'Anchors',
  'layer.names': 'Names',
  'layer.ellipses': 'Ellipses (2 σ)',
  'layer.trails': 'Trails',
  panels: 'Panels',
  'tab.tags': 'Tags',
  'tab.zones': 'Rooms',
  'tab.history': 'History',
  'tab.health': 'Anchors',
  'tab.events': 'Events',
  'tab.survey': 'Survey',
  'tab.plan': 'Plan',
  'tags.search': 'Search by name, address or room',
  'tags.list': 'Tags of this site',
  'tags.count': '{shown} of {all} tags',
  'tags.none': 'No tag yet. Connect a source, or look at simulated tags:',
  'tags.nomatch': 'No tag matches.',
  'tags.table': 'As a table',
  'tags.silent': 'silent since {time}',
  'tags.nowhere': 'no position: {reason}',
  'tags.suspect': 'doubtful: ranges contradict each other',
  'tags.ambiguous': 'or at {x}, {y} m',
  'tags.identify': 'Flash its light',
  'tags.flashes': '{tag} flashes its light for {seconds} s.',
  'tags.asleep': '{tag} has not answered yet. If it sleeps, its light flashes when it wakes.',
  'tags.refuses': '{tag} does not flash its light: {state}',
  tag: 'Tag',
  room: 'Room',
  'zones.zones': 'Zones',
  time: 'Time',
  rate: 'Rate',
  'sites.none': 'No site yet. Start the station with one, or look at simulated tags:',
  'zones.none': 'No room or zone yet. Press “Draw”, click its corners on the map, give it a name and save it.',
  'zones.draw': 'Draw',
  'zones.drawing':
    'Click the corners on the map, or move the map with the arrow keys and press Enter. Backspace takes the last corner back. Drag a corner to move it.',
  'zones.kind': 'Kind',
  'zones.room': 'Room',
  'zones.zone': 'Zone',
  'zones.alarm': 'Alarm when a tag enters',
  'zones.corners': 'Corners (x y in metres, one a line)',
  'zones.few': 'An outline needs three corners or more.',
  'zones.noname': 'Give it a name.',
  'zones.exists': 'There is one with this name already.',
  'zones.inside': '{count} inside',
  'zones.alarmed': 'alarm',
  'history.from': 'From',
  'history.to': 'To',
  'history.load': 'Load',
  'history.loading': 'Loading…',
  'history.last10': 'Last 10 minutes',
  'history.lasthour': 'Last hour',
  'history.today': 'Today',
  'history.none': 'No position in this span. Choose another one.',
  'history.span': 'The end must be after the beginning.',
  'history.rows': '{rows} positions of {tags} tags, one every {step} s',
  'history.cut': 'Only the first {rows} positions: choose a shorter span for the rest.',
  'history.at': 'Time shown',
  'history.play': 'Play',
  'history.pause': 'Pause',
  'history.speed': 'Speed',
  'history.live': 'Back to live',
  'history.heat': 'Heat map of time spent',
  'history.heat.of': 'Of',
  'history.heat.all': 'all tags',
  'history.heat.max': 'Darkest: {seconds} s in {cell} m × {cell} m',
  'history.start': 'Choose a span and press “Load”.',
  'history.chart': 'Chart of a tag',
  'history.chart.help': 'x, y and σ in metres',
  'history.gpx': 'Track for maps (GPX)',
  'history.gpx.help': 'Of the tag in the chart, at most the last {rows} positions of the span.',
  'health.none': 'No anchor or beacon yet. They appear with the site’s file, or when a tag measures to them.',
  'health.node': 'Anchor',
  'health.state': 'State',
  'health.success': 'Success',
  'health.residual': 'Residual',
  'health.supply': 'Supply',
  'health.good': 'good',
  'health.moved': 'was it moved?',
  'health.unseen': 'not seen',
  'health.weak': 'few answers',
  'health.nlos': 'obstructed',
  'health.day': '{name}: the last 24 hours',
  'health.day.help': 'Success rate in %, mean residual in metres. A gap: no tag measured to it.',
  'health.day.success': 'Lowest success rate: {value} at {time}.',
  'health.day.residual': 'Residual farthest from zero: {value} at {time}.',
  'health.day.none':
    'Nothing is known of the last 24 hours of {name}. The station notes once a minute how the ranges to an anchor were.',
  'health.help':
    'An anchor’s name shows it on the map, and its last 24 hours. Residual: measured minus expected range, mean ± σ. First path minus received power: 0 to −6 dB with line of sight. Clock offset: against the clocks of the tags; one that differs from all others by more than 20 ppm has a bad crystal. An anchor whose residual stays far from zero was probably moved: measure its place again.',
  'events.none': 'No event yet. Draw a room or a zone: entering and leaving it is told here.',
  'events.kind': 'Kind',
  'events.all': 'all',
  'events.more': 'Older events',
  'events.sound': 'Sound with alarms',
  'events.entered': '{node} entered {zone}',
  'events.left': '{node} left {zone} after {dwell}',
  'events.silent': '{node} is silent',
  'events.back': '{node} reports again',
  'events.moved': '{node} was probably moved',
  'events.uncertain': '{node}: position too uncertain',
  'events.low-supply': '{node}: supply is low',
  'events.refusals': '{node} refuses many frames: forged ones?',
  'kind.entered': 'entered',
  'kind.left': 'left',
  'kind.silent': 'silent',
  'kind.back': 'back',
  'kind.moved': 'moved',
  'kind.uncertain': 'uncertain',
  'kind.low-supply': 'low supply',
  'kind.refusals': 'refused frames',
  alarm: 'Alarm',
  notices: 'Notices',
  'survey.none': 'No campaign yet. Make one: points on a grid over the site, at which a terminal collects samples.',
  'survey.new': 'New campaign',
  'survey.spacing': 'Grid (m)',
  'survey.create': 'Make it',
  'survey.nogrid': 'The site has no room, wall, plan or anchor yet: nobody knows where the grid would be.',
  'survey.many': '{count} points are too many (at most 500): take a wider grid.',
  'survey.campaign': 'Campaign',
  'survey.points': 'Points',
  'survey.progress': '{done} of {all} points have samples',
  'survey.go': 'Go to point {point}: x {x}, y {y} m',
  'survey.samples': '{count} samples at this point',
  'survey.next': 'Next point',
  'survey.previous': 'Previous point',
  'survey.how':
    'A browser cannot receive Bluetooth advertisements. A terminal that stands at this point posts what it receives:',
  'survey.command': 'Command',
  'plan.none': 'No plan yet. Choose a picture of the floor, then click two points whose distance you know.',
  'plan.choose': 'Choose a picture (PNG, JPEG, WebP)',
  'plan.nopicture': 'This file is no picture that the browser can read.',
  'plan.scale': 'Set the scale: click two points',
  'plan.distance': 'Distance between them (m)',
  'plan.apply': 'Use this scale',
  'plan.origin': 'Set the place: click a known point',
  'plan.originx': 'Its x (m)',
  'plan.originy': 'Its y (m)',
  'plan.place': 'Put it there',
  'plan.rotation': 'Rotation (°, anticlockwise)',
  'plan.mpp': '{mpp} m per pixel; upper left corner at {x}, {y} m',
  'plan.first': 'Click the first point on the map.',
  'plan.second': 'Click the second point.',
  'plan.both': 'Two points are set. Type their distance.',
  'plan.pick': 'Click a point whose coordinates you know.',
  'plan.picked': 'Type the coordinates of the point.',
  'plan.bad': 'The distance must be greater than zero, and the points must not be the same.',
  'plan.save': 'Save the plan',
  'plan.picture': 'Picture',
  'plan.walls': 'Walls',
  'plan.walls.count': '{count} walls',
  'plan.walls.draw': 'Draw walls',
  'plan.walls.help': 'Click the ends on the map: each click continues the wall. “New wall” begins elsewhere.',
  'plan.walls.break': 'New wall',
  'plan.walls.undo': 'Take the last one back',
  'plan.walls.save': 'Save the walls',
  origin: 'Geographic origin',
  'origin.none': 'No geographic origin yet. GPX and NMEA need one for latitudes and longitudes.',
  'origin.at': 'x = 0, y = 0 is at latitude {latitude}°, longitude {longitude}°',
  'origin.azimuth': 'azimuth of the y axis {azimuth}°',
  'origin.height': 'z = 0 is {height} m above mean sea level',
  'origin.separation': 'the geoid is {separation} m above the ellipsoid',
  'origin.set': 'Set the geographic origin',
  'origin.change': 'Change the geographic origin',
  'origin.help':
    'Latitude and longitude are those of the point x = 0, y = 0 in WGS 84; south and west are negative. With the azimuth 0, y points north and x points east.',
  'origin.latitude_deg': 'Latitude (°, north)',
  'origin.longitude_deg': 'Longitude (°, east)',
  'origin.y_azimuth_deg': 'Azimuth of the y axis (°, clockwise from true north)',
  'origin.height_m': 'Height of z = 0 above mean sea level (m, optional)',
  'origin.geoid_separation_m': 'Height of the geoid above the ellipsoid (m, optional)',
  'origin.wrong': '{field}: type a number from {least} to {greatest}.',
};

export type Key = keyof typeof en;

export function isKey(text: string): text is Key {
  return Object.hasOwn(en, text);
}

const es: Record<Key, string> = {
  'app.title': 'Estación Baliza',
  skip: 'Saltar al panel',
  site: 'Sitio',
  language: 'Idioma',
  theme: 'Aspecto',
  'theme.auto': 'Como el sistema',
  'theme.light': 'Claro',
  'theme.dark': 'Oscuro',
  login: 'Entrar',
  logout: 'Salir',
  'login.title': 'Esta estación pregunta quién es usted',
  'login.help': 'Pida un token a quien administra la estación. La sesión se guarda en una cookie de este navegador.',
  'login.token': 'Token',
  'login.wrong': 'La estación no conoce este token.',
  'login.in': 'Iniciar sesión',
  'login.or': 'O con un token:',
  'sign-in.away': 'El proveedor de identidad no responde. Inténtelo más tarde.',
  'sign-in.unknown': 'Ese inicio de sesión ha terminado o ha tardado demasiado. Inicie sesión otra vez.',
  'sign-in.denied': 'El proveedor ha rechazado el inicio de sesión.',
  'sign-in.distrusted': 'La respuesta del proveedor no es de fiar. El registro de la estación dice por qué.',
  'sign-in.no-role': 'El proveedor le conoce, pero no tiene ningún rol en esta estación. Pídalo a quien la administra.',
  'sign-in.too-many': 'Demasiados inicios de sesión desde aquí. Espere un minuto.',
  'state.connecting': 'conectando…',
  'state.live': 'en directo',
  'state.reconnecting': 'reconectando…',
  'state.history': 'historial',
  cancel: 'Cancelar',
  save: 'Guardar',
  delete: 'Borrar',
  really: '¿Borrar de verdad?',
  close: 'Cerrar',
  name: 'Nombre',
  failed: 'No ha sido posible: {message}',
  saved: 'Guardado: {name}',
  deleted: 'Borrado: {name}',
  readonly: 'Su rol no lo permite.',
  map: 'Mapa',
  'map.help':
    'Mapa del sitio. Las flechas lo mueven, más y menos cambian la escala, 0 muestra todo, Intro pone un punto en la cruz. Las etiquetas están en el panel Etiquetas, también como tabla.',
  'map.in': 'Acercar',
  'map.out': 'Alejar',
  'map.fit': 'Ver todo',
  'map.layers': 'Se muestra',
  'layer.plan': 'Plano y paredes',
  'layer.zones': 'Salas y zonas',
  'layer.nodes': 'Anclas',
  'layer.names': 'Nombres',
  'layer.ellipses': 'Elipses (2 σ)',
  'layer.trails': 'Estelas',
  panels: 'Paneles',
  'tab.tags': 'Etiquetas',
  'tab.zones': 'Salas',
  'tab.history': 'Historial',
  'tab.health': 'Anclas',
  'tab.events': 'Eventos',
  'tab.survey': 'Campaña',
  'tab.plan': 'Plano',
  'tags.search': 'Buscar por nombre, dirección o sala',
  'tags.list': 'Etiquetas de este sitio',
  'tags.count': '{shown} de {all} etiquetas',
  'tags.none': 'Aún no hay etiquetas. Conecte una fuente, o vea etiquetas simuladas:',
  'tags.nomatch': 'Ninguna etiqueta coincide.',
  'tags.table': 'Como tabla',
  'tags.silent': 'callada desde {time}',
  'tags.nowhere': 'sin posición: {reason}',
  'tags.suspect': 'dudosa: las distancias se contradicen',
  'tags.ambiguous': 'o en {x}, {y} m',
  'tags.identify': 'Encender su luz',
  'tags.flashes': 'La luz de {tag} parpadea durante {seconds} s.',
  'tags.asleep': '{tag} aún no ha contestado. Si duerme, su luz parpadeará cuando despierte.',
  'tags.refuses': 'La luz de {tag} no parpadea: {state}',
  tag: 'Etiqueta',
  room: 'Sala',
  'zones.zones': 'Zonas',
  time: 'Hora',
  rate: 'Frecuencia',
  'sites.none': 'Aún no hay ningún sitio. Arranque la estación con uno, o vea etiquetas simuladas:',
  'zones.none':
    'Aún no hay salas ni zonas. Pulse «Dibujar», haga clic en sus esquinas en el mapa, dele un nombre y guárdela.',
  'zones.draw': 'Dibujar',
  'zones.drawing':
    'Haga clic en las esquinas en el mapa, o mueva el mapa con las flechas y pulse Intro. Retroceso quita la última esquina. Arrastre una esquina para moverla.',
  'zones.kind': 'Tipo',
  'zones.room': 'Sala',
  'zones.zone': 'Zona',
  'zones.alarm': 'Alarma cuando entra una etiqueta',
  'zones.corners': 'Esquinas (x y en metros, una por línea)',
  'zones.few': 'Un contorno necesita al menos tres esquinas.',
  'zones.noname': 'Dele un nombre.',
  'zones.exists': 'Ya hay una con este nombre.',
  'zones.inside': '{count} dentro',
  'zones.alarmed': 'alarma',
  'history.from': 'Desde',
  'history.to': 'Hasta',
  'history.load': 'Cargar',
  'history.loading': 'Cargando…',
  'history.last10': 'Últimos 10 minutos',
  'history.lasthour': 'Última hora',
  'history.today': 'Hoy',
  'history.none': 'No hay posiciones en este intervalo. Elija otro.',
  'history.span': 'El final debe ser posterior al comienzo.',
  'history.rows': '{rows} posiciones de {tags} etiquetas, una cada {step} s',
  'history.cut': 'Solo las primeras {rows} posiciones: elija un intervalo más corto para ver el resto.',
  'history.at': 'Hora mostrada',
  'history.play': 'Reproducir',
  'history.pause': 'Pausa',
  'history.speed': 'Velocidad',
  'history.live': 'Volver al directo',
  'history.heat': 'Mapa de calor del tiempo de estancia',
  'history.heat.of': 'De',
  'history.heat.all': 'todas las etiquetas',
  'history.heat.max': 'Lo más oscuro: {seconds} s en {cell} m × {cell} m',
  'history.start': 'Elija un intervalo y pulse «Cargar».',
  'history.chart': 'Gráfica de una etiqueta',
  'history.chart.help': 'x, y y σ en metros',
  'history.gpx': 'Recorrido para mapas (GPX)',
  'history.gpx.help': 'De la etiqueta de la gráfica, como mucho las últimas {rows} posiciones del intervalo.',
  'health.none':
    'Aún no hay anclas ni balizas. Aparecen con el fichero del sitio, o cuando una etiqueta mide distancias a ellas.',
  'health.node': 'Ancla',
  'health.state': 'Estado',
  'health.success': 'Éxito',
  'health.residual': 'Residuo',
  'health.supply': 'Alimentación',
  'health.good': 'bien',
  'health.moved': '¿se ha movido?',
  'health.unseen': 'no vista',
  'health.weak': 'pocas respuestas',
  'health.nlos': 'obstruida',
  'health.day': '{name}: las últimas 24 horas',
  'health.day.help': 'Tasa de éxito en %, residuo medio en metros. Un hueco: ninguna etiqueta midió distancias a ella.',
  'health.day.success': 'Menor tasa de éxito: {value} a las {time}.',
  'health.day.residual': 'Residuo más lejano de cero: {value} a las {time}.',
  'health.day.none':
    'No se sabe nada de las últimas 24 horas de {name}. La estación anota una vez por minuto cómo fueron las distancias a un ancla.',
  'health.help':
    'El nombre de un ancla la muestra en el mapa, y sus últimas 24 horas. Residuo: distancia medida menos esperada, media ± σ. Primer camino menos potencia recibida: de 0 a −6 dB con visión directa. Desvío del reloj: frente a los relojes de las etiquetas; el que difiere de todos los demás en más de 20 ppm tiene un mal cristal. Un ancla cuyo residuo sigue lejos de cero probablemente se ha movido: mida otra vez su lugar.',
  'events.none': 'Aún no hay eventos. Dibuje una sala o una zona: aquí se dice quién entra y quién sale.',
  'events.kind': 'Tipo',
  'events.all': 'todos',
  'events.more': 'Eventos anteriores',
  'events.sound': 'Sonido con las alarmas',
  'events.entered': '{node} ha entrado en {zone}',
  'events.left': '{node} ha salido de {zone} tras {dwell}',
  'events.silent': '{node} está callada',
  'events.back': '{node} informa de nuevo',
  'events.moved': '{node} probablemente se ha movido',
  'events.uncertain': '{node}: posición demasiado incierta',
  'events.low-supply': '{node}: alimentación baja',
  'events.refusals': '{node} rechaza muchas tramas: ¿falsas?',
  'kind.entered': 'entrada',
  'kind.left': 'salida',
  'kind.silent': 'callada',
  'kind.back': 'de vuelta',
  'kind.moved': 'movida',
  'kind.uncertain': 'incierta',
  'kind.low-supply': 'alimentación baja',
  'kind.refusals': 'tramas rechazadas',
  alarm: 'Alarma',
  notices: 'Avisos',
  'survey.none':
    'Aún no hay campañas. Haga una: puntos en una cuadrícula sobre el sitio, en los que un terminal recoge muestras.',
  'survey.new': 'Nueva campaña',
  'survey.spacing': 'Cuadrícula (m)',
  'survey.create': 'Crear',
  'survey.nogrid': 'El sitio aún no tiene salas, paredes, plano ni anclas: no se sabe dónde iría la cuadrícula.',
  'survey.many': '{count} puntos son demasiados (como mucho 500): tome una cuadrícula más ancha.',
  'survey.campaign': 'Campaña',
  'survey.points': 'Puntos',
  'survey.progress': '{done} de {all} puntos tienen muestras',
  'survey.go': 'Vaya al punto {point}: x {x}, y {y} m',
  'survey.samples': '{count} muestras en este punto',
  'survey.next': 'Punto siguiente',
  'survey.previous': 'Punto anterior',
  'survey.how':
    'Un navegador no puede recibir anuncios de Bluetooth. Un terminal que está en este punto envía lo que recibe:',
  'survey.command': 'Orden',
  'plan.none': 'Aún no hay plano. Elija una imagen de la planta y haga clic en dos puntos cuya distancia conozca.',
  'plan.choose': 'Elegir una imagen (PNG, JPEG, WebP)',
  'plan.nopicture': 'Este fichero no es una imagen que el navegador pueda leer.',
  'plan.scale': 'Fijar la escala: dos clics',
  'plan.distance': 'Distancia entre ellos (m)',
  'plan.apply': 'Usar esta escala',
  'plan.origin': 'Fijar el lugar: clic en un punto conocido',
  'plan.originx': 'Su x (m)',
  'plan.originy': 'Su y (m)',
  'plan.place': 'Ponerlo ahí',
  'plan.rotation': 'Giro (°, antihorario)',
  'plan.mpp': '{mpp} m por píxel; esquina superior izquierda en {x}, {y} m',
  'plan.first': 'Haga clic en el primer punto en el mapa.',
  'plan.second': 'Haga clic en el segundo punto.',
  'plan.both': 'Los dos puntos están fijados. Escriba su distancia.',
  'plan.pick': 'Haga clic en un punto cuyas coordenadas conozca.',
  'plan.picked': 'Escriba las coordenadas del punto.',
  'plan.bad': 'La distancia debe ser mayor que cero, y los puntos no deben coincidir.',
  'plan.save': 'Guardar el plano',
  'plan.picture': 'Imagen',
  'plan.walls': 'Paredes',
  'plan.walls.count': '{count} paredes',
  'plan.walls.draw': 'Dibujar paredes',
  'plan.walls.help':
    'Haga clic en los extremos en el mapa: cada clic continúa la pared. «Otra pared» empieza en otro sitio.',
  'plan.walls.break': 'Otra pared',
  'plan.walls.undo': 'Quitar la última',
  'plan.walls.save': 'Guardar las paredes',
  origin: 'Origen geográfico',
  'origin.none': 'Aún no hay origen geográfico. GPX y NMEA lo necesitan para las latitudes y longitudes.',
  'origin.at': 'x = 0, y = 0 está en la latitud {latitude}°, longitud {longitude}°',
  'origin.azimuth': 'acimut del eje y {azimuth}°',
  'origin.height': 'z = 0 está a {height} m sobre el nivel medio del mar',
  'origin.separation': 'el geoide está a {separation} m sobre el elipsoide',
  'origin.set': 'Fijar el origen geográfico',
  'origin.change': 'Cambiar el origen geográfico',
  'origin.help':
    'La latitud y la longitud son las del punto x = 0, y = 0 en WGS 84; el sur y el oeste son negativos. Con el acimut 0, y apunta al norte y x al este.',
  'origin.latitude_deg': 'Latitud (°, norte)',
  'origin.longitude_deg': 'Longitud (°, este)',
  'origin.y_azimuth_deg': 'Acimut del eje y (°, horario desde el norte verdadero)',
  'origin.height_m': 'Altura de z = 0 sobre el nivel medio del mar (m, opcional)',
  'origin.geoid_separation_m': 'Altura del geoide sobre el elipsoide (m, opcional)',
  'origin.wrong': '{field}: escriba un número de {least} a {greatest}.',
};

export type Language = 'en' | 'es';

/// A text in all languages, for what stands in one place only.
export type Text = Record<Language, string>;

const texts: Record<Language, Record<Key, string>> = { en, es };

let current: Language = 'en';

export function language(): Language {
  return current;
}

/// The first language of `wanted` that the page speaks.
export function chooseLanguage(wanted: readonly string[]): Language {
  for (const tag of wanted) {
    const base = tag.toLowerCase().split('-')[0];
    if (base === 'en' || base === 'es') return base;
  }
  return 'en';
}

export function setLanguage(next: Language): void {
  current = next;
  numbers.clear();
}

/// The text of a key, or a text of its own, in the current language.
export function t(text: Key | Text, values: Record<string, string | number> = {}): string {
  const pattern = typeof text === 'string' ? texts[current][text] : text[current];
  return pattern.replace(/\{(\w+)\}/g, (whole, name: string) => String(values[name] ?? whole));
}

/// The current language as the person's own region has it, where that is known.
function region(): string {
  const own = typeof navigator === 'undefined' ? [] : (navigator.languages ?? []);
  return own.find((tag) => tag.toLowerCase().split('-')[0] === current) ?? current;
}

const numbers = new Map<number, Intl.NumberFormat>();

/// A supply voltage.
export function supply(volts: number | null): string {
  return volts === null ? '–' : `${number(volts, 2)} V`;
}

/// The number that a person has typed; NaN where it is none. A comma is a decimal point in Spanish, as in the page's own
/// numbers.
export function parseNumber(text: string): number {
  const trimmed = text.trim();
  return trimmed === '' ? NaN : Number(trimmed.replace(',', '.'));
}

export function number(value: number, digits: number): string {
  let format = numbers.get(digits);
  if (format === undefined) {
    format = new Intl.NumberFormat(region(), { minimumFractionDigits: digits, maximumFractionDigits: digits });
    numbers.set(digits, format);
  }
  return format.format(value);
}

const collator = new Intl.Collator(undefined, { numeric: true });

/// The order of names: "Tag 2" before "Tag 10".
export const inOrder = (a: string, b: string): number => collator.compare(a, b);

/// A number with its sign.
export function signed(value: number, digits: number): string {
  return `${value > 0 ? '+' : ''}${number(value, digits)}`;
}

/// The time of the day, with the date where it is not today.
export function time(at: string | number): string {
  const date = new Date(at);
  if (Number.isNaN(date.getTime())) return '–';
  const clock = date.toLocaleTimeString(region(), { hour: '2-digit', minute: '2-digit', second: '2-digit' });
  if (date.toDateString() === new Date().toDateString()) return clock;
  return `${date.toLocaleDateString(region(), { day: 'numeric', month: 'short', year: 'numeric' })} ${clock}`;
}

/// The time of the day, to the minute or the second.
export function clock(at: number, seconds: boolean): string {
  const second = seconds ? ('2-digit' as const) : undefined;
  return new Date(at).toLocaleTimeString(region(), { hour: '2-digit', minute: '2-digit', second });
}

export function duration(seconds: number): string {
  if (seconds < 90) return `${number(seconds, 0)} s`;
  if (seconds < 5400) return `${number(seconds / 60, 0)} min`;
  return `${number(seconds / 3600, 1)} h`;
}
