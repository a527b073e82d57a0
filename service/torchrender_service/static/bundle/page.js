function Sr(r){let e=r.world_from_camera;return{turn:[e[0],e[1],e[2],e[4],e[5],e[6],e[8],e[9],e[10]],eye:[e[3],e[7],e[11]]}}function yf(r){let[e,t,i,n,s,a,o,l,c]=r,h=s*c-a*l,u=a*o-n*c,f=n*l-s*o,p=1/(e*h+t*u+i*f);return[h,i*l-t*c,t*a-i*s,u,e*c-i*o,i*n-e*a,f,t*o-e*l,e*s-t*n].map(g=>g*p)}function Jh(r,e){let t=new Array(9);for(let i=0;i<3;i++)for(let n=0;n<3;n++)t[3*i+n]=r[3*i]*e[n]+r[3*i+1]*e[3+n]+r[3*i+2]*e[6+n];return t}var Mf=(r,e)=>[0,3,6].map(t=>r[t]*e[0]+r[t+1]*e[1]+r[t+2]*e[2]);function $o(r,e,t,i){let n=Sr(r),s=Sr(e),a=yf(s.turn),o=[1/r.fx,0,-r.cx/r.fx,0,1/r.fy,-r.cy/r.fy,0,0,1],l=Jh(Jh(a,n.turn),o),c=Mf(a,[0,1,2].map(d=>n.eye[d]-s.eye[d])),h=[0,1,2].map(d=>[l[3*d],l[3*d+1],l[3*d+2],c[d]]),[u,f,p]=h,g=[u.map((d,_)=>2/e.width*(e.fx*d+e.cx*p[_])-p[_]),f.map((d,_)=>p[_]-2/e.height*(e.fy*d+e.cy*p[_])),p.map((d,_)=>d-(_===3?2*t*(1-i):0)),p];return[0,1,2,3].flatMap(d=>g.map(_=>_[d]))}var Ot=(r,e)=>[r[0]-e[0],r[1]-e[1],r[2]-e[2]],yt=r=>Math.hypot(r[0],r[1],r[2]),Xi=(r,e)=>r[0]*e[0]+r[1]*e[1]+r[2]*e[2],zn=(r,e)=>[r[1]*e[2]-r[2]*e[1],r[2]*e[0]-r[0]*e[2],r[0]*e[1]-r[1]*e[0]],Ze=(r,e)=>[r[0]*e,r[1]*e,r[2]*e],lt=(r,e)=>[r[0]+e[0],r[1]+e[1],r[2]+e[2]],ht=r=>Ze(r,1/(yt(r)||1));function Jo(r,e){let t=e.fx/r.fx,i=e.fy/r.fy;return{left:e.cx-t*r.cx,across:t,top:e.cy-i*r.cy,down:i}}function Qh(r,e,t){let[i,n]=[Sr(r),Sr(e)],s=Math.max(...n.turn.map((a,o)=>Math.abs(a-i.turn[o])));return r.fx*(s+yt(Ot(n.eye,i.eye))/t)}var mt=r=>Sr(r).eye,li=r=>{let e=r.world_from_camera;return[0,1,2].map(t=>[e[t],e[4+t],e[8+t]])};function dn(r,e,[t,i,n]){let s=[0,1,2].flatMap(a=>[t[a],i[a],n[a],e[a]]);return{...r,world_from_camera:[...s,0,0,0,1]}}function Qo(r,e,t){let i=Math.cos(t),n=Ze(e,Xi(e,r)*(1-i));return lt(lt(Ze(r,i),Ze(zn(e,r),Math.sin(t))),n)}function eu(r,e){let t=Xi(ht(li(r)[2]),ht(li(e)[2]));return Math.acos(Math.min(1,Math.max(-1,t)))}var Sf=r=>Math.abs(r)<.15?0:Math.sign(r)*((Math.abs(r)-.15)/.85)**2;function tu(){let r=[...navigator.getGamepads?.()??[]].find(a=>a?.connected);if(!r)return{};let[e,t,i,n]=[0,1,2,3].map(a=>Sf(r.axes[a]??0)),s=a=>r.buttons[a]?.value??0;return{right:e,forward:-t,yaw:i,pitch:-n,up:s(7)-s(6)}}var bf=.14,iu=1.1,wf=.09,nu=1.5,Tf=6e-4,Ef=.0015,Cs=.11,Af=.2,Cf=5e-4,ru=1.2,Rf=.7,If=.002,Pf=.002,Lf=.1,Uf=4,Df=.35,Rs=44,el={KeyW:["forward",1],KeyS:["forward",-1],KeyA:["right",-1],KeyD:["right",1],Space:["up",1],ShiftLeft:["up",-1],ShiftRight:["up",-1],ArrowLeft:["yaw",-1],ArrowRight:["yaw",1],ArrowUp:["pitch",1],ArrowDown:["pitch",-1]};function tl(r,e){let t=ht(r),i=zn(t,e),n=yt(i)>1e-6?ht(i):ht(zn(t,[e[1],e[2],e[0]]));return[n,zn(t,n),t]}var Is=class{constructor(e,t){this.stage=e,this.stick=t,this.held=new Set,this.pointers=new Map,this.pad={},this.panning=!1,this.push=[0,0],this.turn=[0,0],this.jump=[0,0,0],this.coast=0,this.speed=1,this.drift=[0,0,0],this.velocity=[0,0,0],this.mode="walk",this.pivot=[0,0,0],this.obstacles=null,this.spin=[0,0,0],this.camera=null,this.listen()}place(e,t,i,{bounds:n,mode:s="walk"}){this.home=e,this.up=ht(t),this.diagonal=i,this.bounds=n,this.mode=s,this.obstacles=null,this.reset()}reset(){this.jumpTo(this.home)}jumpTo(e){let{world_from_camera:t,near:i}=e;this.camera={...this.camera??e,world_from_camera:t,near:i},e===this.home&&(this.camera=e),this.velocity=[0,0,0],this.drift=[0,0,0],this.turn=[0,0],this.jump=[0,0,0],this.coast=0,this.findPivot(),this.given=i,e.target&&(this.pivot=e.target,this.bringNear())}bringNear(){let e=this.orbiting?Lf*this.distance:1/0;this.camera={...this.camera,near:Math.min(this.given,Pf*this.diagonal,e)}}setMode(e){e!==this.mode&&(this.mode=e,this.coast=0,this.drift=[0,0,0],this.camera&&this.findPivot())}findPivot(){let e=Ze(lt(...this.bounds),.5),t=mt(this.camera),i=ht(li(this.camera)[2]),n=Math.max(.05*this.diagonal,Xi(Ot(e,t),i));this.pivot=lt(t,Ze(i,n))}orbitAbout(e){let t=mt(this.camera);this.camera=dn(this.camera,t,tl(Ot(e,t),this.up)),this.pivot=e,this.bringNear()}listen(){let{stage:e,stick:t}=this;window.addEventListener("keydown",n=>{if(!(![e,document.body].includes(document.activeElement)||n.ctrlKey||n.metaKey||n.altKey)){if(n.code==="Home"||n.code==="KeyR")this.camera&&this.reset();else if(el[n.code])this.held.add(n.code);else return;n.preventDefault()}}),window.addEventListener("keyup",n=>this.held.delete(n.code));let i=()=>{this.held.clear(),this.pointers.clear(),this.setStick(0,0)};window.addEventListener("blur",i),document.addEventListener("focusin",()=>this.held.clear()),e.addEventListener("pointerdown",n=>{n.preventDefault(),document.activeElement?.blur(),e.setPointerCapture(n.pointerId),this.pointers.set(n.pointerId,[n.clientX,n.clientY]),this.panning=n.button>0||n.shiftKey}),e.addEventListener("contextmenu",n=>n.preventDefault()),e.addEventListener("pointermove",n=>this.drag(n));for(let n of["pointerup","pointercancel"])e.addEventListener(n,s=>this.pointers.delete(s.pointerId));e.addEventListener("wheel",n=>{n.preventDefault();let s=n.deltaMode===1?32:1,a=this.orbiting?1.5:Af*(this.diagonal??0),o=this.orbiting?Ef:Tf*(this.diagonal??0);this.coast=Math.max(-a,Math.min(a,this.coast-s*n.deltaY*o))},{passive:!1}),t.addEventListener("pointerdown",n=>{t.setPointerCapture(n.pointerId),this.moveStick(n)}),t.addEventListener("pointermove",n=>t.hasPointerCapture(n.pointerId)&&this.moveStick(n));for(let n of["pointerup","pointercancel"])t.addEventListener(n,()=>this.setStick(0,0))}drag(e){let t=this.pointers.get(e.pointerId);if(!t||!this.camera)return;let i=[e.clientX,e.clientY],n=this.camera.height/this.camera.fy/this.stage.clientHeight,s=n*(this.orbiting?this.distance:.3*this.diagonal);if(this.pointers.size===1&&this.panning)this.jump[0]-=s*(i[0]-t[0]),this.jump[1]+=s*(i[1]-t[1]);else if(this.pointers.size===1&&this.orbiting){let a=Math.PI/this.stage.clientHeight;this.turn[0]+=(i[0]-t[0])*a,this.turn[1]-=(i[1]-t[1])*a}else if(this.pointers.size===1)this.turn[0]-=(i[0]-t[0])*n,this.turn[1]+=(i[1]-t[1])*n;else if(this.pointers.size===2){let[a]=[...this.pointers].filter(([l])=>l!==e.pointerId).map(([,l])=>l),o=l=>Math.hypot(l[0]-a[0],l[1]-a[1]);this.orbiting?(this.coast+=Math.log(o(i)/Math.max(1,o(t))),this.jump[0]-=.5*s*(i[0]-t[0]),this.jump[1]+=.5*s*(i[1]-t[1])):(this.jump[2]+=.0015*this.diagonal*(o(i)-o(t)),this.jump[1]+=4e-4*this.diagonal*(i[1]-t[1]))}this.pointers.set(e.pointerId,i)}moveStick(e){let t=this.stick.getBoundingClientRect(),i=(e.clientX-t.left-t.width/2)/Rs,n=(e.clientY-t.top-t.height/2)/Rs,s=Math.max(1,Math.hypot(i,n));this.setStick(i/s,n/s)}setStick(e,t){this.push=[e,-t];let i=this.stick.firstElementChild;i&&(i.style.transform=`translate(${e*Rs*.6}px, ${t*Rs*.6}px)`)}get orbiting(){return this.mode==="orbit"}get distance(){return yt(Ot(this.pivot,mt(this.camera)))}wish(e){let t=this.pad[e]??0;for(let i of this.held)el[i][0]===e&&(t+=el[i][1]);return Math.max(-1,Math.min(1,t))}step(e){if(!this.camera||e<=0)return!1;this.pad=tu();let t=mt(this.camera),i=this.turn[0]+this.wish("yaw")*iu*e,n=this.turn[1]+this.wish("pitch")*iu*e;this.turn=[0,0];let s=this.look(i,n);this.spin=Ze(s.spin,1/e);let a=this.orbiting?this.circle(e,i!==0||s.pitch!==0):this.walk(e);this.velocity=Ze(Ot(mt(this.camera),t),1/e);let o=i!==0||s.pitch!==0||a;return o&&this.bringNear(),o}foreseen(e){if(this.coast===0&&!this.obstacles)return this.velocity;if(this.orbiting)return Ze(this.velocity,this.coast===0?1:Math.min(1,Cs/e));let t=ht(li(this.camera)[2]),i=lt(Ze(this.drift,e),Ze(t,this.coast*(1-Math.exp(-e/Cs)))),n=mt(this.camera),s=this.within(this.obstacles?this.obstacles.move(n,i):lt(n,i));return Ze(Ot(s,n),1/e)}roll(e){let t=this.coast*(1-Math.exp(-e/Cs));this.coast-=t;let i=this.orbiting?1:this.diagonal;return Math.abs(this.coast)<Cs*Cf*i&&(this.coast=0),t}circle(e,t){let i=li(this.camera),[n,s,a]=i.map(ht),o=this.roll(e)+this.wish("forward")*ru*e+this.push[1]*ru*e,l=this.distance*Math.exp(-o),c=Math.max(If*this.diagonal,Math.min(Uf*this.diagonal,l)),h=Rf*c*e,u=[this.jump[0]+h*(this.wish("right")+this.push[0]),this.jump[1]+h*this.wish("up")];return this.jump=[0,0,0],this.pivot=lt(this.pivot,lt(Ze(n,u[0]),Ze(s,-u[1]))),!t&&o===0&&u[0]===0&&u[1]===0?!1:(this.camera=dn(this.camera,Ot(this.pivot,Ze(a,c)),i),!0)}look(e,t){let i=li(this.camera),n=Math.asin(Math.max(-1,Math.min(1,Xi(ht(i[2]),this.up)))),s=Math.max(Math.min(-nu,n),Math.min(Math.max(nu,n),n+t))-n;if(e===0&&s===0)return{pitch:0,spin:[0,0,0]};let a=Ze(this.up,-1);i=i.map(h=>Qo(h,a,e)),i=i.map(h=>Qo(h,ht(i[0]),s));let o=lt(Ze(a,e),Ze(ht(i[0]),s)),l=ht(i[0]),c=ht(lt(i[2],Ze(l,-Xi(i[2],l))));return this.camera=dn(this.camera,mt(this.camera),[l,zn(c,l),c]),{pitch:s,spin:i.map(h=>Xi(h,o))}}walk(e){let[t,,i]=li(this.camera),n=lt(i,Ze(this.up,-Xi(i,this.up))),s=yt(n)>1e-6?ht(n):ht(i),a=(_,m,v)=>lt(lt(Ze(ht(t),_),Ze(this.up,m)),Ze(s,v)),[o,l]=this.push,c=a(this.wish("right")+o,this.wish("up"),this.wish("forward")+l);yt(c)>1&&(c=ht(c));let h=bf*this.diagonal*this.speed,u=1-Math.exp(-e/wf);this.drift=this.drift.map((_,m)=>_+(h*c[m]-_)*u),yt(c)===0&&yt(this.drift)<.01*h&&(this.drift=[0,0,0]);let f=lt(a(...this.jump),Ze(ht(i),this.roll(e)));this.jump=[0,0,0];let p=lt(Ze(this.drift,e),f);if(yt(p)===0)return!1;let g=mt(this.camera),d=this.obstacles?this.obstacles.move(g,p):lt(g,p);return this.camera=dn(this.camera,this.within(d),li(this.camera)),!0}within(e){let t=mt(this.home),i=Df*this.diagonal,[n,s]=this.bounds;return e.map((a,o)=>Math.min(Math.max(s[o],t[o])+i,Math.max(Math.min(n[o],t[o])-i,a)))}};var au=8,Nf=1e12,Ff=.2,Of=1e-8,ou=()=>Object.fromEntries(new URLSearchParams(location.search));function lu(r){let e=new URLSearchParams(location.search);for(let[i,n]of Object.entries(r))n==null?e.delete(i):e.set(i,n);let t=e.toString().replaceAll("%2C",",");history.replaceState(null,"",t?`?${t}`:location.pathname)}var il=(r,e=au)=>Number(r.toPrecision(e)),su=r=>Math.max(...r.map(Math.abs));function nl(r){let e=mt(r.camera),t=Math.max(Ff*r.diagonal,Of*su(e)),i=r.orbiting?r.pivot:lt(e,Ze(ht(li(r.camera)[2]),t)),n=yt(Ot(i,e))||1,s=Math.ceil(Math.max(0,Math.log10(su(e)/n))),a=Math.min(17,au+s);return{eye:e.map(o=>il(o,a)),target:i.map(o=>il(o,a))}}function cu(r){let{eye:e,target:t}=nl(r);return[...e,...t].join(",")}function hu(r,e,t){let i=(r??"").split(",").map(Number);if(i.length!==6||!i.every(o=>Math.abs(o)<=Nf))return null;let[n,s]=[i.slice(0,3),i.slice(3)],a=s.map((o,l)=>o-n[l]);return Math.hypot(...a)===0?null:{...dn(e,n,tl(a,t)),target:s}}var uu=r=>il(360/Math.PI*Math.atan(.5*r.height/r.fy));function du(r,e,{ev:t,tone:i}){let{eye:n,target:s}=nl(r),{width:a,height:o}=r.camera,l=u=>`(${u.join(", ")})`,c=[t===null?null:`exposure=${t}`,i==="none"?null:`tone_map="${i}"`].filter(Boolean),h=c.length?`, options=tr.RenderOptions(${c.join(", ")})`:"";return`import torchrender as tr

scene = tr.load(${JSON.stringify(e)})
camera = tr.Cameras.look_at(${l(n)}, ${l(s)}, width=${a}, height=${o}, fov_deg=${uu(r.camera)})
tr.render(scene, camera${h}).save("view.png")
`}function pu(r,e,{ev:t,tone:i}){let{eye:n,target:s}=nl(r),{width:a,height:o}=r.camera,l=u=>u.join(","),c=/^[\w./-]+$/.test(e)?e:`'${e.replaceAll("'","'\\''")}'`,h=[t===null?null:`--exposure=${t}`,i==="none"?null:`--tone-map ${i}`].filter(Boolean);return["torchrender render",c,`--camera eye=${l(n)} target=${l(s)} fov=${uu(r.camera)}`,`--size ${a}x${o}`,...h,"-o view.png"].join(" ")}var Ps=class{constructor(){this.worker=new Worker(new URL("./decode-worker.js",import.meta.url),{type:"module"}),this.waiting=new Map,this.serial=0,this.worker.onmessage=({data:{serial:e,image:t,error:i}})=>{let{resolve:n,reject:s}=this.waiting.get(e);this.waiting.delete(e),i?s(new Error(i)):n(t)},this.worker.onerror=e=>{for(let{reject:t}of this.waiting.values())t(new Error(e.message||"the decoder stopped"));this.waiting.clear()}}decode(e,t){let i=++this.serial;return new Promise((n,s)=>{this.waiting.set(i,{resolve:n,reject:s}),this.worker.postMessage({serial:i,buffer:e,maxPixels:t},[e])})}};var Bf={moving:"a picture",still:"the refined picture",smooth:"smooth outlines"},Ls=class{constructor(e){this.client=e,this.status={doing:null,since_ms:0,ahead:0},this.heardAt=0,this.pending=null}hear(e){this.status=e,this.heardAt=performance.now()}expect(e,t){let i=new Set([...this.pending?.names??[],t]);this.pending={seq:e,names:i,since:this.pending?.since??performance.now()}}arrived(e){this.pending&&(e.settings??0)>=this.pending.seq&&(this.pending=null)}get silence(){let{state:e,stream:t}=this.client;return e==="live"&&t.heard?performance.now()-t.heard:null}get age(){let{keyframes:e,walker:t}=this.client,i=e.newest?.header;if(!i||!t.camera)return null;let n=t.camera.world_from_camera;return!(!i.still&&i.scene_s!==void 0)&&i.camera.world_from_camera.every((o,l)=>Math.abs(o-n[l])<1e-6)&&!this.pending?null:performance.now()-i.time_ms}kind(e){let t=this.client.wishes?.max_error;return t&&e==="still"?`the picture within an error of ${t}`:Bf[e]}get notice(){let{state:e,keyframes:t}=this.client;if(e!=="live")return null;if(this.silence>2500)return{kind:"bad",text:"no answer",ms:this.silence};let{ahead:i,doing:n,since_ms:s}=this.status,a=s+performance.now()-this.heardAt;if(i>0)return{kind:"busy",text:`server busy: ${i} ahead`};if(this.pending&&performance.now()-this.pending.since>700){let c=performance.now()-this.pending.since;return{kind:"busy",text:`waiting for ${[...this.pending.names].join(", ")}`,ms:c}}if(!t.newest)return{kind:"busy",text:"first picture",ms:n?a:void 0};let o=this.age,l=o>3e3;return n&&a>700?{kind:l?"busy":"good",text:`making ${this.kind(n)}`,ms:a}:l?{kind:"busy",text:"picture is old",ms:o}:null}};var fu=3,kf=2,zf=.01,Gf=.02,Vf=.2,Hf=.1,Wf=1.3,Xf=3,rl=r=>1+r.extra.length+(r.picture.mirrors?1:0),mu=(r,e)=>Math.abs(r-e)<=1e-6*e,Us=class{constructor(){this.warp=null,this.groups=[],this.leaving=[],this.cut=null,this.home=null}get newest(){return this.groups[0]??null}add(e){let{id:t,layer:i,layers:n,camera:s}=e.header,a=this.groups.find(u=>u.id===t);if(i>0)return a?e.header.mirrors?this.warp.addMirrors(a.picture,this.warp.add(e)):a.extra.push(this.warp.add(e)):e.color.close(),a===this.newest&&a&&rl(a)===n&&this.dropRepeated(a),null;a&&this.drop(a);let o=({scene_s:u=null,revision:f=0})=>`${u} ${f}`;for(let u of this.groups.filter(f=>o(f.header)!==o(e.header)))this.drop(u);if(this.cut!==null&&mu(s.near,this.cut)){for(let u of this.groups.filter(f=>!mu(f.camera.near,this.cut)))this.drop(u);this.cut=null}let l={id:t,camera:s,typical:e.typical,header:e.header,picture:this.warp.add(e),extra:[]};this.groups.unshift(l),n===1&&this.dropRepeated(l);let c=this.atHome(),h=()=>this.order(s).filter(u=>u!==c);for(;this.groups.length-(c?1:0)>fu+1;)this.drop(h().findLast(u=>u!==l));return l}atHome(){let{home:e}=this;return e?this.groups.filter(i=>this.samePlace(i.camera,e,i.typical)).sort((i,n)=>this.fineness(n)-this.fineness(i))[0]??null:null}samePlace(e,t,i,n=1){return yt(Ot(mt(e),mt(t)))<n*zf*i&&eu(e,t)<n*Gf}outdate(){for(let e of this.groups)e.outdated=!0}dropRepeated(e){let{typical:t}=e,i=a=>!a.outdated&&this.fineness(a)>1.01*this.fineness(e),n=(a,o,l)=>this.samePlace(a.camera,o.camera,t,l),s=a=>this.groups.some(o=>o!==e&&o!==a&&n(o,a));for(let a of this.groups.filter(o=>o!==e&&n(o,e)&&!i(o)))(n(a,e,Vf)||a.outdated||s(a))&&this.drop(a)}fineness(e){return e.camera.fx*(e.header.still?Xf:1)}sharpness(e,t){let i=yt(Ot(mt(e.camera),mt(t)))/(Hf*e.typical),n=e===this.newest?Wf:1;return e.outdated?0:n*this.fineness(e)/(1+i*i)}order(e){let t=new Map(this.groups.map(i=>[i,this.sharpness(i,e)]));return[...this.groups].sort((i,n)=>t.get(n)-t.get(i))}drop(e){this.groups=this.groups.filter(t=>t!==e),this.leaving.push(e.picture,...e.extra)}sweep(e=[]){let t=this.leaving.filter(i=>!e.includes(i));for(let i of t)this.warp.remove(i);this.leaving=this.leaving.filter(i=>e.includes(i))}clear(){for(let e of[...this.groups])this.drop(e);this.sweep()}pictures(e,{earlier:t=!0,layers:i=!0,most:n=fu}={}){let s=t?this.order(e).slice(0,n+1):this.groups.slice(0,1),a=i?s.slice(0,kf).flatMap(o=>o.extra):[];return[...s.map(o=>o.picture),...a]}};var Ds=class{constructor(){this.events=[]}add(e,t=performance.now()){this.events.push([t,e])}perSecond(e=performance.now()){for(;this.events.length&&this.events[0][0]<e-3e3;)this.events.shift();return this.events.reduce((t,[,i])=>t+i,0)/(3e3/1e3)}},jf=9,Ns=class{constructor(){this.recent=[]}add(e){this.recent.push(e),this.recent.length>jf&&this.recent.shift()}get value(){let e=[...this.recent].sort((t,i)=>t-i);return e.length?e[e.length-1>>1]:null}},Gn=class{constructor(){this.value=null}add(e){this.value=this.value===null?e:this.value+.1*(e-this.value)}};function gu(r){let e=r.length,t=0,i=0;for(;i<e;){let n=r.charCodeAt(i++);if((n&4294967168)===0){t++;continue}else if((n&4294965248)===0)t+=2;else{if(n>=55296&&n<=56319&&i<e){let s=r.charCodeAt(i);(s&64512)===56320&&(++i,n=((n&1023)<<10)+(s&1023)+65536)}(n&4294901760)===0?t+=3:t+=4}}return t}function qf(r,e,t){let i=r.length,n=t,s=0;for(;s<i;){let a=r.charCodeAt(s++);if((a&4294967168)===0){e[n++]=a;continue}else if((a&4294965248)===0)e[n++]=a>>6&31|192;else{if(a>=55296&&a<=56319&&s<i){let o=r.charCodeAt(s);(o&64512)===56320&&(++s,a=((a&1023)<<10)+(o&1023)+65536)}(a&4294901760)===0?(e[n++]=a>>12&15|224,e[n++]=a>>6&63|128):(e[n++]=a>>18&7|240,e[n++]=a>>12&63|128,e[n++]=a>>6&63|128)}e[n++]=a&63|128}}var Yf=new TextEncoder,Zf=50;function Kf(r,e,t){Yf.encodeInto(r,e.subarray(t))}function vu(r,e,t){r.length>Zf?Kf(r,e,t):qf(r,e,t)}var $f=4096;function sl(r,e,t){let i=e,n=i+t,s=[],a="";for(;i<n;){let o=r[i++];if((o&128)===0)s.push(o);else if((o&224)===192){let l=r[i++]&63;s.push((o&31)<<6|l)}else if((o&240)===224){let l=r[i++]&63,c=r[i++]&63;s.push((o&31)<<12|l<<6|c)}else if((o&248)===240){let l=r[i++]&63,c=r[i++]&63,h=r[i++]&63,u=(o&7)<<18|l<<12|c<<6|h;u>65535&&(u-=65536,s.push(u>>>10&1023|55296),u=56320|u&1023),s.push(u)}else s.push(o);s.length>=$f&&(a+=String.fromCharCode(...s),s.length=0)}return s.length>0&&(a+=String.fromCharCode(...s)),a}var Jf=new TextDecoder,Qf=200;function em(r,e,t){let i=r.subarray(e,e+t);return Jf.decode(i)}function _u(r,e,t){return t>Qf?em(r,e,t):sl(r,e,t)}var ji=class{type;data;constructor(e,t){this.type=e,this.data=t}};var Bt=class r extends Error{constructor(e){super(e);let t=Object.create(r.prototype);Object.setPrototypeOf(this,t),Object.defineProperty(this,"name",{configurable:!0,enumerable:!1,value:r.name})}};function xu(r,e,t){let i=t/4294967296,n=t;r.setUint32(e,i),r.setUint32(e+4,n)}function Fs(r,e,t){let i=Math.floor(t/4294967296),n=t;r.setUint32(e,i),r.setUint32(e+4,n)}function Os(r,e){let t=r.getInt32(e),i=r.getUint32(e+4);return t*4294967296+i}function yu(r,e){let t=r.getUint32(e),i=r.getUint32(e+4);return t*4294967296+i}var Mu=-1,tm=4294967296-1,im=17179869184-1;function Su({sec:r,nsec:e}){if(r>=0&&e>=0&&r<=im)if(e===0&&r<=tm){let t=new Uint8Array(4);return new DataView(t.buffer).setUint32(0,r),t}else{let t=r/4294967296,i=r&4294967295,n=new Uint8Array(8),s=new DataView(n.buffer);return s.setUint32(0,e<<2|t&3),s.setUint32(4,i),n}else{let t=new Uint8Array(12),i=new DataView(t.buffer);return i.setUint32(0,e),Fs(i,4,r),t}}function bu(r){let e=r.getTime(),t=Math.floor(e/1e3),i=(e-t*1e3)*1e6,n=Math.floor(i/1e9);return{sec:t+n,nsec:i-n*1e9}}function wu(r){if(r instanceof Date){let e=bu(r);return Su(e)}else return null}function Tu(r){let e=new DataView(r.buffer,r.byteOffset,r.byteLength);switch(r.byteLength){case 4:return{sec:e.getUint32(0),nsec:0};case 8:{let t=e.getUint32(0),i=e.getUint32(4),n=(t&3)*4294967296+i,s=t>>>2;return{sec:n,nsec:s}}case 12:{let t=Os(e,4),i=e.getUint32(0);return{sec:t,nsec:i}}default:throw new Bt(`Unrecognized data size for timestamp (expected 4, 8, or 12): ${r.length}`)}}function Eu(r){let e=Tu(r);return new Date(e.sec*1e3+e.nsec/1e6)}var Au={type:Mu,encode:wu,decode:Eu};var pn=class r{static defaultCodec=new r;__brand;builtInEncoders=[];builtInDecoders=[];encoders=[];decoders=[];constructor(){this.register(Au)}register({type:e,encode:t,decode:i}){if(e>=0)this.encoders[e]=t,this.decoders[e]=i;else{let n=-1-e;this.builtInEncoders[n]=t,this.builtInDecoders[n]=i}}tryToEncode(e,t){for(let i=0;i<this.builtInEncoders.length;i++){let n=this.builtInEncoders[i];if(n!=null){let s=n(e,t);if(s!=null){let a=-1-i;return new ji(a,s)}}}for(let i=0;i<this.encoders.length;i++){let n=this.encoders[i];if(n!=null){let s=n(e,t);if(s!=null){let a=i;return new ji(a,s)}}}return e instanceof ji?e:null}decode(e,t,i){let n=t<0?this.builtInDecoders[-1-t]:this.decoders[t];return n?n(e,t,i):new ji(t,e)}};function nm(r){return r instanceof ArrayBuffer||typeof SharedArrayBuffer<"u"&&r instanceof SharedArrayBuffer}function br(r){return r instanceof Uint8Array?r:ArrayBuffer.isView(r)?new Uint8Array(r.buffer,r.byteOffset,r.byteLength):nm(r)?new Uint8Array(r):Uint8Array.from(r)}var rm=100,sm=2048,wr=class r{extensionCodec;context;useBigInt64;maxDepth;initialBufferSize;sortKeys;forceFloat32;ignoreUndefined;forceIntegerToFloat;pos;view;bytes;entered=!1;constructor(e){this.extensionCodec=e?.extensionCodec??pn.defaultCodec,this.context=e?.context,this.useBigInt64=e?.useBigInt64??!1,this.maxDepth=e?.maxDepth??rm,this.initialBufferSize=e?.initialBufferSize??sm,this.sortKeys=e?.sortKeys??!1,this.forceFloat32=e?.forceFloat32??!1,this.ignoreUndefined=e?.ignoreUndefined??!1,this.forceIntegerToFloat=e?.forceIntegerToFloat??!1,this.pos=0,this.view=new DataView(new ArrayBuffer(this.initialBufferSize)),this.bytes=new Uint8Array(this.view.buffer)}clone(){return new r({extensionCodec:this.extensionCodec,context:this.context,useBigInt64:this.useBigInt64,maxDepth:this.maxDepth,initialBufferSize:this.initialBufferSize,sortKeys:this.sortKeys,forceFloat32:this.forceFloat32,ignoreUndefined:this.ignoreUndefined,forceIntegerToFloat:this.forceIntegerToFloat})}reinitializeState(){this.pos=0}encodeSharedRef(e){if(this.entered)return this.clone().encodeSharedRef(e);try{return this.entered=!0,this.reinitializeState(),this.doEncode(e,1),this.bytes.subarray(0,this.pos)}finally{this.entered=!1}}encode(e){if(this.entered)return this.clone().encode(e);try{return this.entered=!0,this.reinitializeState(),this.doEncode(e,1),this.bytes.slice(0,this.pos)}finally{this.entered=!1}}doEncode(e,t){if(t>this.maxDepth)throw new Error(`Too deep objects in depth ${t}`);e==null?this.encodeNil():typeof e=="boolean"?this.encodeBoolean(e):typeof e=="number"?this.forceIntegerToFloat?this.encodeNumberAsFloat(e):this.encodeNumber(e):typeof e=="string"?this.encodeString(e):this.useBigInt64&&typeof e=="bigint"?this.encodeBigInt64(e):this.encodeObject(e,t)}ensureBufferSizeToWrite(e){let t=this.pos+e;this.view.byteLength<t&&this.resizeBuffer(t*2)}resizeBuffer(e){let t=new ArrayBuffer(e),i=new Uint8Array(t),n=new DataView(t);i.set(this.bytes),this.view=n,this.bytes=i}encodeNil(){this.writeU8(192)}encodeBoolean(e){e===!1?this.writeU8(194):this.writeU8(195)}encodeNumber(e){!this.forceIntegerToFloat&&Number.isSafeInteger(e)?e>=0?e<128?this.writeU8(e):e<256?(this.writeU8(204),this.writeU8(e)):e<65536?(this.writeU8(205),this.writeU16(e)):e<4294967296?(this.writeU8(206),this.writeU32(e)):this.useBigInt64?this.encodeNumberAsFloat(e):(this.writeU8(207),this.writeU64(e)):e>=-32?this.writeU8(224|e+32):e>=-128?(this.writeU8(208),this.writeI8(e)):e>=-32768?(this.writeU8(209),this.writeI16(e)):e>=-2147483648?(this.writeU8(210),this.writeI32(e)):this.useBigInt64?this.encodeNumberAsFloat(e):(this.writeU8(211),this.writeI64(e)):this.encodeNumberAsFloat(e)}encodeNumberAsFloat(e){this.forceFloat32?(this.writeU8(202),this.writeF32(e)):(this.writeU8(203),this.writeF64(e))}encodeBigInt64(e){e>=BigInt(0)?(this.writeU8(207),this.writeBigUint64(e)):(this.writeU8(211),this.writeBigInt64(e))}writeStringHeader(e){if(e<32)this.writeU8(160+e);else if(e<256)this.writeU8(217),this.writeU8(e);else if(e<65536)this.writeU8(218),this.writeU16(e);else if(e<4294967296)this.writeU8(219),this.writeU32(e);else throw new Error(`Too long string: ${e} bytes in UTF-8`)}encodeString(e){let i=gu(e);this.ensureBufferSizeToWrite(5+i),this.writeStringHeader(i),vu(e,this.bytes,this.pos),this.pos+=i}encodeObject(e,t){let i=this.extensionCodec.tryToEncode(e,this.context);if(i!=null)this.encodeExtension(i);else if(Array.isArray(e))this.encodeArray(e,t);else if(ArrayBuffer.isView(e))this.encodeBinary(e);else if(typeof e=="object")this.encodeMap(e,t);else throw new Error(`Unrecognized object: ${Object.prototype.toString.apply(e)}`)}encodeBinary(e){let t=e.byteLength;if(t<256)this.writeU8(196),this.writeU8(t);else if(t<65536)this.writeU8(197),this.writeU16(t);else if(t<4294967296)this.writeU8(198),this.writeU32(t);else throw new Error(`Too large binary: ${t}`);let i=br(e);this.writeU8a(i)}encodeArray(e,t){let i=e.length;if(i<16)this.writeU8(144+i);else if(i<65536)this.writeU8(220),this.writeU16(i);else if(i<4294967296)this.writeU8(221),this.writeU32(i);else throw new Error(`Too large array: ${i}`);for(let n of e)this.doEncode(n,t+1)}countWithoutUndefined(e,t){let i=0;for(let n of t)e[n]!==void 0&&i++;return i}encodeMap(e,t){let i=Object.keys(e);this.sortKeys&&i.sort();let n=this.ignoreUndefined?this.countWithoutUndefined(e,i):i.length;if(n<16)this.writeU8(128+n);else if(n<65536)this.writeU8(222),this.writeU16(n);else if(n<4294967296)this.writeU8(223),this.writeU32(n);else throw new Error(`Too large map object: ${n}`);for(let s of i){let a=e[s];this.ignoreUndefined&&a===void 0||(this.encodeString(s),this.doEncode(a,t+1))}}encodeExtension(e){if(typeof e.data=="function"){let i=e.data(this.pos+6),n=i.length;if(n>=4294967296)throw new Error(`Too large extension object: ${n}`);this.writeU8(201),this.writeU32(n),this.writeI8(e.type),this.writeU8a(i);return}let t=e.data.length;if(t===1)this.writeU8(212);else if(t===2)this.writeU8(213);else if(t===4)this.writeU8(214);else if(t===8)this.writeU8(215);else if(t===16)this.writeU8(216);else if(t<256)this.writeU8(199),this.writeU8(t);else if(t<65536)this.writeU8(200),this.writeU16(t);else if(t<4294967296)this.writeU8(201),this.writeU32(t);else throw new Error(`Too large extension object: ${t}`);this.writeI8(e.type),this.writeU8a(e.data)}writeU8(e){this.ensureBufferSizeToWrite(1),this.view.setUint8(this.pos,e),this.pos++}writeU8a(e){let t=e.length;this.ensureBufferSizeToWrite(t),this.bytes.set(e,this.pos),this.pos+=t}writeI8(e){this.ensureBufferSizeToWrite(1),this.view.setInt8(this.pos,e),this.pos++}writeU16(e){this.ensureBufferSizeToWrite(2),this.view.setUint16(this.pos,e),this.pos+=2}writeI16(e){this.ensureBufferSizeToWrite(2),this.view.setInt16(this.pos,e),this.pos+=2}writeU32(e){this.ensureBufferSizeToWrite(4),this.view.setUint32(this.pos,e),this.pos+=4}writeI32(e){this.ensureBufferSizeToWrite(4),this.view.setInt32(this.pos,e),this.pos+=4}writeF32(e){this.ensureBufferSizeToWrite(4),this.view.setFloat32(this.pos,e),this.pos+=4}writeF64(e){this.ensureBufferSizeToWrite(8),this.view.setFloat64(this.pos,e),this.pos+=8}writeU64(e){this.ensureBufferSizeToWrite(8),xu(this.view,this.pos,e),this.pos+=8}writeI64(e){this.ensureBufferSizeToWrite(8),Fs(this.view,this.pos,e),this.pos+=8}writeBigUint64(e){this.ensureBufferSizeToWrite(8),this.view.setBigUint64(this.pos,e),this.pos+=8}writeBigInt64(e){this.ensureBufferSizeToWrite(8),this.view.setBigInt64(this.pos,e),this.pos+=8}};function al(r,e){return new wr(e).encodeSharedRef(r)}function Bs(r){return`${r<0?"-":""}0x${Math.abs(r).toString(16).padStart(2,"0")}`}var am=16,om=16,ks=class{hit=0;miss=0;caches;maxKeyLength;maxLengthPerKey;constructor(e=am,t=om){this.maxKeyLength=e,this.maxLengthPerKey=t,this.caches=[];for(let i=0;i<this.maxKeyLength;i++)this.caches.push([])}canBeCached(e){return e>0&&e<=this.maxKeyLength}find(e,t,i){let n=this.caches[i-1];e:for(let s of n){let a=s.bytes;for(let o=0;o<i;o++)if(a[o]!==e[t+o])continue e;return s.str}return null}store(e,t){let i=this.caches[e.length-1],n={bytes:e,str:t};i.length>=this.maxLengthPerKey?i[Math.random()*i.length|0]=n:i.push(n)}decode(e,t,i){let n=this.find(e,t,i);if(n!=null)return this.hit++,n;this.miss++;let s=sl(e,t,i),a=Uint8Array.prototype.slice.call(e,t,t+i);return this.store(a,s),s}};var ol="array",Ar="map_key",Ru="map_value",lm=r=>{if(typeof r=="string"||typeof r=="number")return r;throw new Bt("The type of key must be string or number but "+typeof r)},ll=class{stack=[];stackHeadPosition=-1;get length(){return this.stackHeadPosition+1}top(){return this.stack[this.stackHeadPosition]}pushArrayState(e){let t=this.getUninitializedStateFromPool();t.type=ol,t.position=0,t.size=e,t.array=new Array(e)}pushMapState(e){let t=this.getUninitializedStateFromPool();t.type=Ar,t.readCount=0,t.size=e,t.map={}}getUninitializedStateFromPool(){if(this.stackHeadPosition++,this.stackHeadPosition===this.stack.length){let e={type:void 0,size:0,array:void 0,position:0,readCount:0,map:void 0,key:null};this.stack.push(e)}return this.stack[this.stackHeadPosition]}release(e){if(this.stack[this.stackHeadPosition]!==e)throw new Error("Invalid stack state. Released state is not on top of the stack.");if(e.type===ol){let i=e;i.size=0,i.array=void 0,i.position=0,i.type=void 0}if(e.type===Ar||e.type===Ru){let i=e;i.size=0,i.map=void 0,i.readCount=0,i.type=void 0}this.stackHeadPosition--}reset(){this.stack.length=0,this.stackHeadPosition=-1}},Er=-1,cl=new DataView(new ArrayBuffer(0)),cm=new Uint8Array(cl.buffer);try{cl.getInt8(0)}catch(r){if(!(r instanceof RangeError))throw new Error("This module is not supported in the current JavaScript engine because DataView does not throw RangeError on out-of-bounds access")}var Cu=new RangeError("Insufficient data"),hm=new ks,Vn=class r{extensionCodec;context;useBigInt64;rawStrings;maxStrLength;maxBinLength;maxArrayLength;maxMapLength;maxExtLength;keyDecoder;mapKeyConverter;totalPos=0;pos=0;view=cl;bytes=cm;headByte=Er;stack=new ll;entered=!1;constructor(e){this.extensionCodec=e?.extensionCodec??pn.defaultCodec,this.context=e?.context,this.useBigInt64=e?.useBigInt64??!1,this.rawStrings=e?.rawStrings??!1,this.maxStrLength=e?.maxStrLength??4294967295,this.maxBinLength=e?.maxBinLength??4294967295,this.maxArrayLength=e?.maxArrayLength??4294967295,this.maxMapLength=e?.maxMapLength??4294967295,this.maxExtLength=e?.maxExtLength??4294967295,this.keyDecoder=e?.keyDecoder!==void 0?e.keyDecoder:hm,this.mapKeyConverter=e?.mapKeyConverter??lm}clone(){return new r({extensionCodec:this.extensionCodec,context:this.context,useBigInt64:this.useBigInt64,rawStrings:this.rawStrings,maxStrLength:this.maxStrLength,maxBinLength:this.maxBinLength,maxArrayLength:this.maxArrayLength,maxMapLength:this.maxMapLength,maxExtLength:this.maxExtLength,keyDecoder:this.keyDecoder})}reinitializeState(){this.totalPos=0,this.headByte=Er,this.stack.reset()}setBuffer(e){let t=br(e);this.bytes=t,this.view=new DataView(t.buffer,t.byteOffset,t.byteLength),this.pos=0}appendBuffer(e){if(this.headByte===Er&&!this.hasRemaining(1))this.setBuffer(e);else{let t=this.bytes.subarray(this.pos),i=br(e),n=new Uint8Array(t.length+i.length);n.set(t),n.set(i,t.length),this.setBuffer(n)}}hasRemaining(e){return this.view.byteLength-this.pos>=e}createExtraByteError(e){let{view:t,pos:i}=this;return new RangeError(`Extra ${t.byteLength-i} of ${t.byteLength} byte(s) found at buffer[${e}]`)}decode(e){if(this.entered)return this.clone().decode(e);try{this.entered=!0,this.reinitializeState(),this.setBuffer(e);let t=this.doDecodeSync();if(this.hasRemaining(1))throw this.createExtraByteError(this.pos);return t}finally{this.entered=!1}}*decodeMulti(e){if(this.entered){yield*this.clone().decodeMulti(e);return}try{for(this.entered=!0,this.reinitializeState(),this.setBuffer(e);this.hasRemaining(1);)yield this.doDecodeSync()}finally{this.entered=!1}}async decodeAsync(e){if(this.entered)return this.clone().decodeAsync(e);try{this.entered=!0;let t=!1,i;for await(let o of e){if(t)throw this.entered=!1,this.createExtraByteError(this.totalPos);this.appendBuffer(o);try{i=this.doDecodeSync(),t=!0}catch(l){if(!(l instanceof RangeError))throw l}this.totalPos+=this.pos}if(t){if(this.hasRemaining(1))throw this.createExtraByteError(this.totalPos);return i}let{headByte:n,pos:s,totalPos:a}=this;throw new RangeError(`Insufficient data in parsing ${Bs(n)} at ${a} (${s} in the current buffer)`)}finally{this.entered=!1}}decodeArrayStream(e){return this.decodeMultiAsync(e,!0)}decodeStream(e){return this.decodeMultiAsync(e,!1)}async*decodeMultiAsync(e,t){if(this.entered){yield*this.clone().decodeMultiAsync(e,t);return}try{this.entered=!0;let i=t,n=-1;for await(let s of e){if(t&&n===0)throw this.createExtraByteError(this.totalPos);this.appendBuffer(s),i&&(n=this.readArraySize(),i=!1,this.complete());try{for(;yield this.doDecodeSync(),--n!==0;);}catch(a){if(!(a instanceof RangeError))throw a}this.totalPos+=this.pos}}finally{this.entered=!1}}doDecodeSync(){e:for(;;){let e=this.readHeadByte(),t;if(e>=224)t=e-256;else if(e<192)if(e<128)t=e;else if(e<144){let n=e-128;if(n!==0){this.pushMapState(n),this.complete();continue e}else t={}}else if(e<160){let n=e-144;if(n!==0){this.pushArrayState(n),this.complete();continue e}else t=[]}else{let n=e-160;t=this.decodeString(n,0)}else if(e===192)t=null;else if(e===194)t=!1;else if(e===195)t=!0;else if(e===202)t=this.readF32();else if(e===203)t=this.readF64();else if(e===204)t=this.readU8();else if(e===205)t=this.readU16();else if(e===206)t=this.readU32();else if(e===207)this.useBigInt64?t=this.readU64AsBigInt():t=this.readU64();else if(e===208)t=this.readI8();else if(e===209)t=this.readI16();else if(e===210)t=this.readI32();else if(e===211)this.useBigInt64?t=this.readI64AsBigInt():t=this.readI64();else if(e===217){let n=this.lookU8();t=this.decodeString(n,1)}else if(e===218){let n=this.lookU16();t=this.decodeString(n,2)}else if(e===219){let n=this.lookU32();t=this.decodeString(n,4)}else if(e===220){let n=this.readU16();if(n!==0){this.pushArrayState(n),this.complete();continue e}else t=[]}else if(e===221){let n=this.readU32();if(n!==0){this.pushArrayState(n),this.complete();continue e}else t=[]}else if(e===222){let n=this.readU16();if(n!==0){this.pushMapState(n),this.complete();continue e}else t={}}else if(e===223){let n=this.readU32();if(n!==0){this.pushMapState(n),this.complete();continue e}else t={}}else if(e===196){let n=this.lookU8();t=this.decodeBinary(n,1)}else if(e===197){let n=this.lookU16();t=this.decodeBinary(n,2)}else if(e===198){let n=this.lookU32();t=this.decodeBinary(n,4)}else if(e===212)t=this.decodeExtension(1,0);else if(e===213)t=this.decodeExtension(2,0);else if(e===214)t=this.decodeExtension(4,0);else if(e===215)t=this.decodeExtension(8,0);else if(e===216)t=this.decodeExtension(16,0);else if(e===199){let n=this.lookU8();t=this.decodeExtension(n,1)}else if(e===200){let n=this.lookU16();t=this.decodeExtension(n,2)}else if(e===201){let n=this.lookU32();t=this.decodeExtension(n,4)}else throw new Bt(`Unrecognized type byte: ${Bs(e)}`);this.complete();let i=this.stack;for(;i.length>0;){let n=i.top();if(n.type===ol)if(n.array[n.position]=t,n.position++,n.position===n.size)t=n.array,i.release(n);else continue e;else if(n.type===Ar){if(t==="__proto__")throw new Bt("The key __proto__ is not allowed");n.key=this.mapKeyConverter(t),n.type=Ru;continue e}else if(n.map[n.key]=t,n.readCount++,n.readCount===n.size)t=n.map,i.release(n);else{n.key=null,n.type=Ar;continue e}}return t}}readHeadByte(){return this.headByte===Er&&(this.headByte=this.readU8()),this.headByte}complete(){this.headByte=Er}readArraySize(){let e=this.readHeadByte();switch(e){case 220:return this.readU16();case 221:return this.readU32();default:{if(e<160)return e-144;throw new Bt(`Unrecognized array type byte: ${Bs(e)}`)}}}pushMapState(e){if(e>this.maxMapLength)throw new Bt(`Max length exceeded: map length (${e}) > maxMapLengthLength (${this.maxMapLength})`);this.stack.pushMapState(e)}pushArrayState(e){if(e>this.maxArrayLength)throw new Bt(`Max length exceeded: array length (${e}) > maxArrayLength (${this.maxArrayLength})`);this.stack.pushArrayState(e)}decodeString(e,t){return!this.rawStrings||this.stateIsMapKey()?this.decodeUtf8String(e,t):this.decodeBinary(e,t)}decodeUtf8String(e,t){if(e>this.maxStrLength)throw new Bt(`Max length exceeded: UTF-8 byte length (${e}) > maxStrLength (${this.maxStrLength})`);if(this.bytes.byteLength<this.pos+t+e)throw Cu;let i=this.pos+t,n;return this.stateIsMapKey()&&this.keyDecoder?.canBeCached(e)?n=this.keyDecoder.decode(this.bytes,i,e):n=_u(this.bytes,i,e),this.pos+=t+e,n}stateIsMapKey(){return this.stack.length>0?this.stack.top().type===Ar:!1}decodeBinary(e,t){if(e>this.maxBinLength)throw new Bt(`Max length exceeded: bin length (${e}) > maxBinLength (${this.maxBinLength})`);if(!this.hasRemaining(e+t))throw Cu;let i=this.pos+t,n=this.bytes.subarray(i,i+e);return this.pos+=t+e,n}decodeExtension(e,t){if(e>this.maxExtLength)throw new Bt(`Max length exceeded: ext length (${e}) > maxExtLength (${this.maxExtLength})`);let i=this.view.getInt8(this.pos+t),n=this.decodeBinary(e,t+1);return this.extensionCodec.decode(n,i,this.context)}lookU8(){return this.view.getUint8(this.pos)}lookU16(){return this.view.getUint16(this.pos)}lookU32(){return this.view.getUint32(this.pos)}readU8(){let e=this.view.getUint8(this.pos);return this.pos++,e}readI8(){let e=this.view.getInt8(this.pos);return this.pos++,e}readU16(){let e=this.view.getUint16(this.pos);return this.pos+=2,e}readI16(){let e=this.view.getInt16(this.pos);return this.pos+=2,e}readU32(){let e=this.view.getUint32(this.pos);return this.pos+=4,e}readI32(){let e=this.view.getInt32(this.pos);return this.pos+=4,e}readU64(){let e=yu(this.view,this.pos);return this.pos+=8,e}readI64(){let e=Os(this.view,this.pos);return this.pos+=8,e}readU64AsBigInt(){let e=this.view.getBigUint64(this.pos);return this.pos+=8,e}readI64AsBigInt(){let e=this.view.getBigInt64(this.pos);return this.pos+=8,e}readF32(){let e=this.view.getFloat32(this.pos);return this.pos+=4,e}readF64(){let e=this.view.getFloat64(this.pos);return this.pos+=8,e}};function hl(r,e){return new Vn(e).decode(r)}var Iu="torchrender.v1",ul=1,ut=Object.freeze({HELLO:1,WELCOME:2,POSE:3,KEYFRAME:4,ACK:5,RESYNC:6,ERROR:7,BYE:8,SETTINGS:9,STATUS:10,LOOK:11,PICK:12,PICKED:13}),Hn=12,Pu=1229214292,um=1<<20,dm=["depth","color","mask"],fn=class extends Error{},dl=r=>r+7&-8;function zs(r,e){let t=al(e),i=new Uint8Array(dl(Hn+t.length)),n=new DataView(i.buffer);return n.setUint32(0,Pu,!0),n.setUint8(4,ul),n.setUint8(5,r),n.setUint16(6,0,!0),n.setUint32(8,t.length,!0),i.set(t,Hn),i}function Lu(r){if(r.byteLength<Hn)throw new fn(`message of ${r.byteLength} bytes is too short`);let e=new DataView(r);if(e.getUint32(0,!0)!==Pu)throw new fn("message does not start with TRDI");if(e.getUint8(4)!==ul)throw new fn(`protocol version ${e.getUint8(4)} is not ${ul}`);let t=e.getUint8(5),i=e.getUint32(8,!0);if(i>um||Hn+i>r.byteLength)throw new fn(`header of ${i} bytes`);let n=hl(new Uint8Array(r,Hn,i)),s=Math.min(dl(Hn+i),r.byteLength),a=t===ut.KEYFRAME?pm(r,s,n):{};return{type:t,header:n,blobs:a,payload:new Uint8Array(r,s)}}function pm(r,e,t){let i={},n=e;for(let s of dm){let a=t[s]?.length;if(a!==void 0){if(!Number.isInteger(a)||a<0||n+a>r.byteLength)throw new fn(`${s} of ${a} bytes does not fit into the message`);i[s]=new Uint8Array(r,n,a),n+=dl(a)}}return i}var fm=new Uint32Array(256).map((r,e)=>{for(let t=0;t<8;t++)e=e&1?3988292384^e>>>1:e>>>1;return e});function Uu(r){let e=4294967295;for(let t=0;t<r.length;t++)e=fm[(e^r[t])&255]^e>>>8;return(e^4294967295)>>>0}var Du=.4,mm=5,gm=8e3,vm=6e4,_m=65536,Wn=class extends Error{constructor(e,t,i){super(t),this.status=e,this.retryAfter=i}};async function Cr(r,{key:e,patience:t=vm,...i}={}){let n={Accept:"application/json",...i.headers};e&&(n.Authorization=`Bearer ${e}`);let s=await fetch(r,{...i,headers:n,signal:AbortSignal.timeout(t)}),a=await s.json().catch(()=>({}));if(!s.ok){let o=Number(s.headers.get("Retry-After"));throw new Wn(s.status,a.detail??a.title??s.statusText,o||void 0)}return a}function pl(r,e){return Cr("v1/sessions",{method:"POST",headers:{"Content-Type":"application/json"},body:JSON.stringify(r),key:e})}var Gs=class{constructor(e){this.handlers=e,this.socket=null,this.generation=0,this.connections=0,window.addEventListener("online",()=>this.wake?.())}start(e,t,i=null){this.stop(),this.asked=i,this.resume=null,this.session=null,this.wishes=e,this.key=t,this.run(++this.generation)}stop(){this.generation++,this.wake?.(),this.socket?.readyState===WebSocket.OPEN&&this.socket.send(zs(ut.BYE,{reason:"left"})),this.socket?.close(),this.socket=null,this.handlers.state("closed")}send(e,t,{droppable:i=!1}={}){return this.socket?.readyState!==WebSocket.OPEN||!this.welcomed||i&&this.socket.bufferedAmount>_m?!1:(this.socket.send(zs(e,t)),!0)}async run(e){let t=Du;for(;e===this.generation;){this.retryAfter=0;try{this.handlers.state("connecting");let n=this.resume??await this.openSession();if(this.resume=null,e!==this.generation)return;await this.listen(n,e)&&(t=Du)}catch(n){if(e!==this.generation)return;if(n instanceof Wn&&n.status>=400&&n.status<500&&n.status!==429)return this.handlers.state("failed",n);this.retryAfter=n.retryAfter??0,this.reason=n.message}if(e!==this.generation)return;let i=Math.max(this.retryAfter,t*(.8+.4*Math.random()));t=Math.min(mm,t*1.7),this.handlers.state("waiting",{seconds:i,reason:this.reason}),await new Promise(n=>{this.wake=n,setTimeout(n,1e3*i)})}}async openSession(){let{asked:e}=this;this.asked=null;let t=await(e??pl(this.wishes,this.key));return this.session=t,t.ticket}listen(e,t){let i=new URL(this.session.stream.replace(/^\//,""),document.baseURI);i.protocol=i.protocol.replace("http","ws");let n=new WebSocket(i,[Iu,`bearer.${e}`]);n.binaryType="arraybuffer",this.socket=n,this.welcomed=!1;let s=setTimeout(()=>!this.welcomed&&n.close(),gm);return n.onopen=()=>{let a=this.wishes.layers,l={versions:[1,1],...{depth:["pz1"],color:["jpeg","webp"],max_pixels:fl,mirrors:!0},layers:a,viewer:!0};n.send(zs(ut.HELLO,l))},n.onmessage=({data:a})=>t===this.generation&&this.receive(a),new Promise(a=>{n.onclose=({code:o,reason:l})=>{clearTimeout(s);let c=this.welcomed;this.socket===n&&(this.welcomed=!1),this.reason=l||(c?"connection lost":`not reached (${o})`),a(c)}})}receive(e){if(this.heard=performance.now(),e.byteLength>5&&new Uint8Array(e,5,1)[0]===ut.KEYFRAME)return this.handlers.keyframe(e);let{type:t,header:i}=Lu(e);t===ut.WELCOME?(this.welcomed=!0,this.heard=performance.now(),this.connections++,this.resume=i.resume,this.handlers.state("live"),this.handlers.welcome(i,this.session)):t===ut.ERROR?this.handlers.problem(i):t===ut.STATUS||t===ut.LOOK||t===ut.PICKED?this.handlers.told(t,i):t===ut.BYE&&(this.retryAfter=i.retry_after_s??0,this.reason=i.reason)}},fl=4096*2304;var od=0,Jl=1,ld=2;var ls=1,cd=2,ur=3,dr=0,Wt=1,Ai=2,ri=0,cs=1,Ql=2,ec=3,tc=4,hd=5;var pr=100,ud=101,dd=102,pd=103,fd=104,md=200,gd=201,vd=202,_d=203,xd=204,yd=205,Md=206,Sd=207,bd=208,wd=209,Td=210,Ed=211,Ad=212,Cd=213,Rd=214,ic=0,nc=1,rc=2,lo=3,sc=4,ac=5,oc=6,lc=7,Id=0,Pd=1,Ld=2,mi=0,cc=1,hc=2,uc=3,dc=4,pc=5,fc=6,mc=7;var gc=300,fr=301,An=302,co=303,ho=304,hs=306,ma=1e3,di=1001,ga=1002,At=1003,Ud=1004;var us=1005;var wt=1006,uo=1007;var Cn=1008;var zt=1009,vc=1010,_c=1011,an=1012,po=1013,Vi=1014,gi=1015,Ci=1016,fo=1017,mo=1018,mr=1020,xc=35902,yc=35899,Dd=1021,Nd=1022,Jt=1023,on=1026,Rn=1027,Mc=1028,In=1029,Pn=1030,Sc=1031;var bc=1033,go=33776,vo=33777,_o=33778,xo=33779,wc=35840,Tc=35841,Ec=35842,Ac=35843,Cc=36196,Rc=37492,Ic=37496,Pc=37488,Lc=37489,yo=37490,Uc=37491,Dc=37808,Nc=37809,Fc=37810,Oc=37811,Bc=37812,kc=37813,zc=37814,Gc=37815,Vc=37816,Hc=37817,Wc=37818,Xc=37819,jc=37820,qc=37821,Yc=36492,Zc=36494,Kc=36495,$c=36283,Jc=36284,Mo=36285,Qc=36286;var Or=2300,va=2301,pa=2302,Vl=2303,Hl=2400,Wl=2401,Xl=2402;var eh=0,Fd=1,Ri="",Yt="srgb",Br="srgb-linear",kr="linear",Ke="srgb";var xn=7680;var Od=512,Bd=513,kd=514,So=515,zd=516,Gd=517,bo=518,Vd=519,jl=35044;var ds="300 es",zi=2e3,zr=2001;function xm(r){return ArrayBuffer.isView(r)&&!(r instanceof DataView)}function Gr(r){return document.createElementNS("http://www.w3.org/1999/xhtml",r)}function Hd(){let r=Gr("canvas");return r.style.display="block",r}var Nu={},nr=null;function th(...r){let e="THREE."+r.shift();nr?nr("log",e,...r):console.log(e,...r)}function Wd(r){let e=r[0];if(typeof e=="string"&&e.startsWith("TSL:")){let t=r[1];t&&t.isStackTrace?r[0]+=" "+t.getLocation():r[1]='Stack trace not available. Enable "THREE.Node.captureStackTrace" to capture stack traces.'}return r}function we(...r){let e="THREE."+(r=Wd(r)).shift();if(nr)nr("warn",e,...r);else{let t=r[0];t&&t.isStackTrace?console.warn(t.getError(e)):console.warn(e,...r)}}function Te(...r){let e="THREE."+(r=Wd(r)).shift();if(nr)nr("error",e,...r);else{let t=r[0];t&&t.isStackTrace?console.error(t.getError(e)):console.error(e,...r)}}function _a(...r){let e=r.join(" ");e in Nu||(Nu[e]=!0,we(...r))}function Xd(r,e,t){return new Promise(function(i,n){setTimeout(function s(){switch(r.clientWaitSync(e,r.SYNC_FLUSH_COMMANDS_BIT,0)){case r.WAIT_FAILED:n();break;case r.TIMEOUT_EXPIRED:setTimeout(s,t);break;default:i()}},t)})}var jd={[ic]:1,[rc]:6,[sc]:7,[lo]:5,[nc]:0,[oc]:2,[lc]:4,[ac]:3},Ei=class{addEventListener(e,t){this._listeners===void 0&&(this._listeners={});let i=this._listeners;i[e]===void 0&&(i[e]=[]),i[e].indexOf(t)===-1&&i[e].push(t)}hasEventListener(e,t){let i=this._listeners;return i!==void 0&&i[e]!==void 0&&i[e].indexOf(t)!==-1}removeEventListener(e,t){let i=this._listeners;if(i===void 0)return;let n=i[e];if(n!==void 0){let s=n.indexOf(t);s!==-1&&n.splice(s,1)}}dispatchEvent(e){let t=this._listeners;if(t===void 0)return;let i=t[e.type];if(i!==void 0){e.target=this;let n=i.slice(0);for(let s=0,a=n.length;s<a;s++)n[s].call(this,e);e.target=null}}},Lt=["00","01","02","03","04","05","06","07","08","09","0a","0b","0c","0d","0e","0f","10","11","12","13","14","15","16","17","18","19","1a","1b","1c","1d","1e","1f","20","21","22","23","24","25","26","27","28","29","2a","2b","2c","2d","2e","2f","30","31","32","33","34","35","36","37","38","39","3a","3b","3c","3d","3e","3f","40","41","42","43","44","45","46","47","48","49","4a","4b","4c","4d","4e","4f","50","51","52","53","54","55","56","57","58","59","5a","5b","5c","5d","5e","5f","60","61","62","63","64","65","66","67","68","69","6a","6b","6c","6d","6e","6f","70","71","72","73","74","75","76","77","78","79","7a","7b","7c","7d","7e","7f","80","81","82","83","84","85","86","87","88","89","8a","8b","8c","8d","8e","8f","90","91","92","93","94","95","96","97","98","99","9a","9b","9c","9d","9e","9f","a0","a1","a2","a3","a4","a5","a6","a7","a8","a9","aa","ab","ac","ad","ae","af","b0","b1","b2","b3","b4","b5","b6","b7","b8","b9","ba","bb","bc","bd","be","bf","c0","c1","c2","c3","c4","c5","c6","c7","c8","c9","ca","cb","cc","cd","ce","cf","d0","d1","d2","d3","d4","d5","d6","d7","d8","d9","da","db","dc","dd","de","df","e0","e1","e2","e3","e4","e5","e6","e7","e8","e9","ea","eb","ec","ed","ee","ef","f0","f1","f2","f3","f4","f5","f6","f7","f8","f9","fa","fb","fc","fd","fe","ff"];var fa=Math.PI/180,xa=180/Math.PI;function gr(){let r=4294967295*Math.random()|0,e=4294967295*Math.random()|0,t=4294967295*Math.random()|0,i=4294967295*Math.random()|0;return(Lt[255&r]+Lt[r>>8&255]+Lt[r>>16&255]+Lt[r>>24&255]+"-"+Lt[255&e]+Lt[e>>8&255]+"-"+Lt[e>>16&15|64]+Lt[e>>24&255]+"-"+Lt[63&t|128]+Lt[t>>8&255]+"-"+Lt[t>>16&255]+Lt[t>>24&255]+Lt[255&i]+Lt[i>>8&255]+Lt[i>>16&255]+Lt[i>>24&255]).toLowerCase()}function Be(r,e,t){return Math.max(e,Math.min(t,r))}function ym(r,e){return(r%e+e)%e}function ml(r,e,t){return(1-t)*r+t*e}function Rr(r,e){switch(e.constructor){case Float32Array:return r;case Uint32Array:return r/4294967295;case Uint16Array:return r/65535;case Uint8Array:return r/255;case Int32Array:return Math.max(r/2147483647,-1);case Int16Array:return Math.max(r/32767,-1);case Int8Array:return Math.max(r/127,-1);default:throw new Error("Invalid component type.")}}function Vt(r,e){switch(e.constructor){case Float32Array:return r;case Uint32Array:return Math.round(4294967295*r);case Uint16Array:return Math.round(65535*r);case Uint8Array:return Math.round(255*r);case Int32Array:return Math.round(2147483647*r);case Int16Array:return Math.round(32767*r);case Int8Array:return Math.round(127*r);default:throw new Error("Invalid component type.")}}var ne=class r{static{r.prototype.isVector2=!0}constructor(e=0,t=0){this.x=e,this.y=t}get width(){return this.x}set width(e){this.x=e}get height(){return this.y}set height(e){this.y=e}set(e,t){return this.x=e,this.y=t,this}setScalar(e){return this.x=e,this.y=e,this}setX(e){return this.x=e,this}setY(e){return this.y=e,this}setComponent(e,t){switch(e){case 0:this.x=t;break;case 1:this.y=t;break;default:throw new Error("index is out of range: "+e)}return this}getComponent(e){switch(e){case 0:return this.x;case 1:return this.y;default:throw new Error("index is out of range: "+e)}}clone(){return new this.constructor(this.x,this.y)}copy(e){return this.x=e.x,this.y=e.y,this}add(e){return this.x+=e.x,this.y+=e.y,this}addScalar(e){return this.x+=e,this.y+=e,this}addVectors(e,t){return this.x=e.x+t.x,this.y=e.y+t.y,this}addScaledVector(e,t){return this.x+=e.x*t,this.y+=e.y*t,this}sub(e){return this.x-=e.x,this.y-=e.y,this}subScalar(e){return this.x-=e,this.y-=e,this}subVectors(e,t){return this.x=e.x-t.x,this.y=e.y-t.y,this}multiply(e){return this.x*=e.x,this.y*=e.y,this}multiplyScalar(e){return this.x*=e,this.y*=e,this}divide(e){return this.x/=e.x,this.y/=e.y,this}divideScalar(e){return this.multiplyScalar(1/e)}applyMatrix3(e){let t=this.x,i=this.y,n=e.elements;return this.x=n[0]*t+n[3]*i+n[6],this.y=n[1]*t+n[4]*i+n[7],this}min(e){return this.x=Math.min(this.x,e.x),this.y=Math.min(this.y,e.y),this}max(e){return this.x=Math.max(this.x,e.x),this.y=Math.max(this.y,e.y),this}clamp(e,t){return this.x=Be(this.x,e.x,t.x),this.y=Be(this.y,e.y,t.y),this}clampScalar(e,t){return this.x=Be(this.x,e,t),this.y=Be(this.y,e,t),this}clampLength(e,t){let i=this.length();return this.divideScalar(i||1).multiplyScalar(Be(i,e,t))}floor(){return this.x=Math.floor(this.x),this.y=Math.floor(this.y),this}ceil(){return this.x=Math.ceil(this.x),this.y=Math.ceil(this.y),this}round(){return this.x=Math.round(this.x),this.y=Math.round(this.y),this}roundToZero(){return this.x=Math.trunc(this.x),this.y=Math.trunc(this.y),this}negate(){return this.x=-this.x,this.y=-this.y,this}dot(e){return this.x*e.x+this.y*e.y}cross(e){return this.x*e.y-this.y*e.x}lengthSq(){return this.x*this.x+this.y*this.y}length(){return Math.sqrt(this.x*this.x+this.y*this.y)}manhattanLength(){return Math.abs(this.x)+Math.abs(this.y)}normalize(){return this.divideScalar(this.length()||1)}angle(){return Math.atan2(-this.y,-this.x)+Math.PI}angleTo(e){let t=Math.sqrt(this.lengthSq()*e.lengthSq());if(t===0)return Math.PI/2;let i=this.dot(e)/t;return Math.acos(Be(i,-1,1))}distanceTo(e){return Math.sqrt(this.distanceToSquared(e))}distanceToSquared(e){let t=this.x-e.x,i=this.y-e.y;return t*t+i*i}manhattanDistanceTo(e){return Math.abs(this.x-e.x)+Math.abs(this.y-e.y)}setLength(e){return this.normalize().multiplyScalar(e)}lerp(e,t){return this.x+=(e.x-this.x)*t,this.y+=(e.y-this.y)*t,this}lerpVectors(e,t,i){return this.x=e.x+(t.x-e.x)*i,this.y=e.y+(t.y-e.y)*i,this}equals(e){return e.x===this.x&&e.y===this.y}fromArray(e,t=0){return this.x=e[t],this.y=e[t+1],this}toArray(e=[],t=0){return e[t]=this.x,e[t+1]=this.y,e}fromBufferAttribute(e,t){return this.x=e.getX(t),this.y=e.getY(t),this}rotateAround(e,t){let i=Math.cos(t),n=Math.sin(t),s=this.x-e.x,a=this.y-e.y;return this.x=s*i-a*n+e.x,this.y=s*n+a*i+e.y,this}random(){return this.x=Math.random(),this.y=Math.random(),this}*[Symbol.iterator](){yield this.x,yield this.y}},ni=class{constructor(e=0,t=0,i=0,n=1){this.isQuaternion=!0,this._x=e,this._y=t,this._z=i,this._w=n}static slerpFlat(e,t,i,n,s,a,o){let l=i[n+0],c=i[n+1],h=i[n+2],u=i[n+3],f=s[a+0],p=s[a+1],g=s[a+2],d=s[a+3];if(u!==d||l!==f||c!==p||h!==g){let _=l*f+c*p+h*g+u*d;_<0&&(f=-f,p=-p,g=-g,d=-d,_=-_);let m=1-o;if(_<.9995){let v=Math.acos(_),y=Math.sin(v);m=Math.sin(m*v)/y,l=l*m+f*(o=Math.sin(o*v)/y),c=c*m+p*o,h=h*m+g*o,u=u*m+d*o}else{l=l*m+f*o,c=c*m+p*o,h=h*m+g*o,u=u*m+d*o;let v=1/Math.sqrt(l*l+c*c+h*h+u*u);l*=v,c*=v,h*=v,u*=v}}e[t]=l,e[t+1]=c,e[t+2]=h,e[t+3]=u}static multiplyQuaternionsFlat(e,t,i,n,s,a){let o=i[n],l=i[n+1],c=i[n+2],h=i[n+3],u=s[a],f=s[a+1],p=s[a+2],g=s[a+3];return e[t]=o*g+h*u+l*p-c*f,e[t+1]=l*g+h*f+c*u-o*p,e[t+2]=c*g+h*p+o*f-l*u,e[t+3]=h*g-o*u-l*f-c*p,e}get x(){return this._x}set x(e){this._x=e,this._onChangeCallback()}get y(){return this._y}set y(e){this._y=e,this._onChangeCallback()}get z(){return this._z}set z(e){this._z=e,this._onChangeCallback()}get w(){return this._w}set w(e){this._w=e,this._onChangeCallback()}set(e,t,i,n){return this._x=e,this._y=t,this._z=i,this._w=n,this._onChangeCallback(),this}clone(){return new this.constructor(this._x,this._y,this._z,this._w)}copy(e){return this._x=e.x,this._y=e.y,this._z=e.z,this._w=e.w,this._onChangeCallback(),this}setFromEuler(e,t=!0){let i=e._x,n=e._y,s=e._z,a=e._order,o=Math.cos,l=Math.sin,c=o(i/2),h=o(n/2),u=o(s/2),f=l(i/2),p=l(n/2),g=l(s/2);switch(a){case"XYZ":this._x=f*h*u+c*p*g,this._y=c*p*u-f*h*g,this._z=c*h*g+f*p*u,this._w=c*h*u-f*p*g;break;case"YXZ":this._x=f*h*u+c*p*g,this._y=c*p*u-f*h*g,this._z=c*h*g-f*p*u,this._w=c*h*u+f*p*g;break;case"ZXY":this._x=f*h*u-c*p*g,this._y=c*p*u+f*h*g,this._z=c*h*g+f*p*u,this._w=c*h*u-f*p*g;break;case"ZYX":this._x=f*h*u-c*p*g,this._y=c*p*u+f*h*g,this._z=c*h*g-f*p*u,this._w=c*h*u+f*p*g;break;case"YZX":this._x=f*h*u+c*p*g,this._y=c*p*u+f*h*g,this._z=c*h*g-f*p*u,this._w=c*h*u-f*p*g;break;case"XZY":this._x=f*h*u-c*p*g,this._y=c*p*u-f*h*g,this._z=c*h*g+f*p*u,this._w=c*h*u+f*p*g;break;default:we("Quaternion: .setFromEuler() encountered an unknown order: "+a)}return t===!0&&this._onChangeCallback(),this}setFromAxisAngle(e,t){let i=t/2,n=Math.sin(i);return this._x=e.x*n,this._y=e.y*n,this._z=e.z*n,this._w=Math.cos(i),this._onChangeCallback(),this}setFromRotationMatrix(e){let t=e.elements,i=t[0],n=t[4],s=t[8],a=t[1],o=t[5],l=t[9],c=t[2],h=t[6],u=t[10],f=i+o+u;if(f>0){let p=.5/Math.sqrt(f+1);this._w=.25/p,this._x=(h-l)*p,this._y=(s-c)*p,this._z=(a-n)*p}else if(i>o&&i>u){let p=2*Math.sqrt(1+i-o-u);this._w=(h-l)/p,this._x=.25*p,this._y=(n+a)/p,this._z=(s+c)/p}else if(o>u){let p=2*Math.sqrt(1+o-i-u);this._w=(s-c)/p,this._x=(n+a)/p,this._y=.25*p,this._z=(l+h)/p}else{let p=2*Math.sqrt(1+u-i-o);this._w=(a-n)/p,this._x=(s+c)/p,this._y=(l+h)/p,this._z=.25*p}return this._onChangeCallback(),this}setFromUnitVectors(e,t){let i=e.dot(t)+1;return i<1e-8?(i=0,Math.abs(e.x)>Math.abs(e.z)?(this._x=-e.y,this._y=e.x,this._z=0,this._w=i):(this._x=0,this._y=-e.z,this._z=e.y,this._w=i)):(this._x=e.y*t.z-e.z*t.y,this._y=e.z*t.x-e.x*t.z,this._z=e.x*t.y-e.y*t.x,this._w=i),this.normalize()}angleTo(e){return 2*Math.acos(Math.abs(Be(this.dot(e),-1,1)))}rotateTowards(e,t){let i=this.angleTo(e);if(i===0)return this;let n=Math.min(1,t/i);return this.slerp(e,n),this}identity(){return this.set(0,0,0,1)}invert(){return this.conjugate()}conjugate(){return this._x*=-1,this._y*=-1,this._z*=-1,this._onChangeCallback(),this}dot(e){return this._x*e._x+this._y*e._y+this._z*e._z+this._w*e._w}lengthSq(){return this._x*this._x+this._y*this._y+this._z*this._z+this._w*this._w}length(){return Math.sqrt(this._x*this._x+this._y*this._y+this._z*this._z+this._w*this._w)}normalize(){let e=this.length();return e===0?(this._x=0,this._y=0,this._z=0,this._w=1):(e=1/e,this._x=this._x*e,this._y=this._y*e,this._z=this._z*e,this._w=this._w*e),this._onChangeCallback(),this}multiply(e){return this.multiplyQuaternions(this,e)}premultiply(e){return this.multiplyQuaternions(e,this)}multiplyQuaternions(e,t){let i=e._x,n=e._y,s=e._z,a=e._w,o=t._x,l=t._y,c=t._z,h=t._w;return this._x=i*h+a*o+n*c-s*l,this._y=n*h+a*l+s*o-i*c,this._z=s*h+a*c+i*l-n*o,this._w=a*h-i*o-n*l-s*c,this._onChangeCallback(),this}slerp(e,t){let i=e._x,n=e._y,s=e._z,a=e._w,o=this.dot(e);o<0&&(i=-i,n=-n,s=-s,a=-a,o=-o);let l=1-t;if(o<.9995){let c=Math.acos(o),h=Math.sin(c);l=Math.sin(l*c)/h,t=Math.sin(t*c)/h,this._x=this._x*l+i*t,this._y=this._y*l+n*t,this._z=this._z*l+s*t,this._w=this._w*l+a*t,this._onChangeCallback()}else this._x=this._x*l+i*t,this._y=this._y*l+n*t,this._z=this._z*l+s*t,this._w=this._w*l+a*t,this.normalize();return this}slerpQuaternions(e,t,i){return this.copy(e).slerp(t,i)}random(){let e=2*Math.PI*Math.random(),t=2*Math.PI*Math.random(),i=Math.random(),n=Math.sqrt(1-i),s=Math.sqrt(i);return this.set(n*Math.sin(e),n*Math.cos(e),s*Math.sin(t),s*Math.cos(t))}equals(e){return e._x===this._x&&e._y===this._y&&e._z===this._z&&e._w===this._w}fromArray(e,t=0){return this._x=e[t],this._y=e[t+1],this._z=e[t+2],this._w=e[t+3],this._onChangeCallback(),this}toArray(e=[],t=0){return e[t]=this._x,e[t+1]=this._y,e[t+2]=this._z,e[t+3]=this._w,e}fromBufferAttribute(e,t){return this._x=e.getX(t),this._y=e.getY(t),this._z=e.getZ(t),this._w=e.getW(t),this._onChangeCallback(),this}toJSON(){return this.toArray()}_onChange(e){return this._onChangeCallback=e,this}_onChangeCallback(){}*[Symbol.iterator](){yield this._x,yield this._y,yield this._z,yield this._w}},A=class r{static{r.prototype.isVector3=!0}constructor(e=0,t=0,i=0){this.x=e,this.y=t,this.z=i}set(e,t,i){return i===void 0&&(i=this.z),this.x=e,this.y=t,this.z=i,this}setScalar(e){return this.x=e,this.y=e,this.z=e,this}setX(e){return this.x=e,this}setY(e){return this.y=e,this}setZ(e){return this.z=e,this}setComponent(e,t){switch(e){case 0:this.x=t;break;case 1:this.y=t;break;case 2:this.z=t;break;default:throw new Error("index is out of range: "+e)}return this}getComponent(e){switch(e){case 0:return this.x;case 1:return this.y;case 2:return this.z;default:throw new Error("index is out of range: "+e)}}clone(){return new this.constructor(this.x,this.y,this.z)}copy(e){return this.x=e.x,this.y=e.y,this.z=e.z,this}add(e){return this.x+=e.x,this.y+=e.y,this.z+=e.z,this}addScalar(e){return this.x+=e,this.y+=e,this.z+=e,this}addVectors(e,t){return this.x=e.x+t.x,this.y=e.y+t.y,this.z=e.z+t.z,this}addScaledVector(e,t){return this.x+=e.x*t,this.y+=e.y*t,this.z+=e.z*t,this}sub(e){return this.x-=e.x,this.y-=e.y,this.z-=e.z,this}subScalar(e){return this.x-=e,this.y-=e,this.z-=e,this}subVectors(e,t){return this.x=e.x-t.x,this.y=e.y-t.y,this.z=e.z-t.z,this}multiply(e){return this.x*=e.x,this.y*=e.y,this.z*=e.z,this}multiplyScalar(e){return this.x*=e,this.y*=e,this.z*=e,this}multiplyVectors(e,t){return this.x=e.x*t.x,this.y=e.y*t.y,this.z=e.z*t.z,this}applyEuler(e){return this.applyQuaternion(Fu.setFromEuler(e))}applyAxisAngle(e,t){return this.applyQuaternion(Fu.setFromAxisAngle(e,t))}applyMatrix3(e){let t=this.x,i=this.y,n=this.z,s=e.elements;return this.x=s[0]*t+s[3]*i+s[6]*n,this.y=s[1]*t+s[4]*i+s[7]*n,this.z=s[2]*t+s[5]*i+s[8]*n,this}applyNormalMatrix(e){return this.applyMatrix3(e).normalize()}applyMatrix4(e){let t=this.x,i=this.y,n=this.z,s=e.elements,a=1/(s[3]*t+s[7]*i+s[11]*n+s[15]);return this.x=(s[0]*t+s[4]*i+s[8]*n+s[12])*a,this.y=(s[1]*t+s[5]*i+s[9]*n+s[13])*a,this.z=(s[2]*t+s[6]*i+s[10]*n+s[14])*a,this}applyQuaternion(e){let t=this.x,i=this.y,n=this.z,s=e.x,a=e.y,o=e.z,l=e.w,c=2*(a*n-o*i),h=2*(o*t-s*n),u=2*(s*i-a*t);return this.x=t+l*c+a*u-o*h,this.y=i+l*h+o*c-s*u,this.z=n+l*u+s*h-a*c,this}project(e){return this.applyMatrix4(e.matrixWorldInverse).applyMatrix4(e.projectionMatrix)}unproject(e){return this.applyMatrix4(e.projectionMatrixInverse).applyMatrix4(e.matrixWorld)}transformDirection(e){let t=this.x,i=this.y,n=this.z,s=e.elements;return this.x=s[0]*t+s[4]*i+s[8]*n,this.y=s[1]*t+s[5]*i+s[9]*n,this.z=s[2]*t+s[6]*i+s[10]*n,this.normalize()}divide(e){return this.x/=e.x,this.y/=e.y,this.z/=e.z,this}divideScalar(e){return this.multiplyScalar(1/e)}min(e){return this.x=Math.min(this.x,e.x),this.y=Math.min(this.y,e.y),this.z=Math.min(this.z,e.z),this}max(e){return this.x=Math.max(this.x,e.x),this.y=Math.max(this.y,e.y),this.z=Math.max(this.z,e.z),this}clamp(e,t){return this.x=Be(this.x,e.x,t.x),this.y=Be(this.y,e.y,t.y),this.z=Be(this.z,e.z,t.z),this}clampScalar(e,t){return this.x=Be(this.x,e,t),this.y=Be(this.y,e,t),this.z=Be(this.z,e,t),this}clampLength(e,t){let i=this.length();return this.divideScalar(i||1).multiplyScalar(Be(i,e,t))}floor(){return this.x=Math.floor(this.x),this.y=Math.floor(this.y),this.z=Math.floor(this.z),this}ceil(){return this.x=Math.ceil(this.x),this.y=Math.ceil(this.y),this.z=Math.ceil(this.z),this}round(){return this.x=Math.round(this.x),this.y=Math.round(this.y),this.z=Math.round(this.z),this}roundToZero(){return this.x=Math.trunc(this.x),this.y=Math.trunc(this.y),this.z=Math.trunc(this.z),this}negate(){return this.x=-this.x,this.y=-this.y,this.z=-this.z,this}dot(e){return this.x*e.x+this.y*e.y+this.z*e.z}lengthSq(){return this.x*this.x+this.y*this.y+this.z*this.z}length(){return Math.sqrt(this.x*this.x+this.y*this.y+this.z*this.z)}manhattanLength(){return Math.abs(this.x)+Math.abs(this.y)+Math.abs(this.z)}normalize(){return this.divideScalar(this.length()||1)}setLength(e){return this.normalize().multiplyScalar(e)}lerp(e,t){return this.x+=(e.x-this.x)*t,this.y+=(e.y-this.y)*t,this.z+=(e.z-this.z)*t,this}lerpVectors(e,t,i){return this.x=e.x+(t.x-e.x)*i,this.y=e.y+(t.y-e.y)*i,this.z=e.z+(t.z-e.z)*i,this}cross(e){return this.crossVectors(this,e)}crossVectors(e,t){let i=e.x,n=e.y,s=e.z,a=t.x,o=t.y,l=t.z;return this.x=n*l-s*o,this.y=s*a-i*l,this.z=i*o-n*a,this}projectOnVector(e){let t=e.lengthSq();if(t===0)return this.set(0,0,0);let i=e.dot(this)/t;return this.copy(e).multiplyScalar(i)}projectOnPlane(e){return gl.copy(this).projectOnVector(e),this.sub(gl)}reflect(e){return this.sub(gl.copy(e).multiplyScalar(2*this.dot(e)))}angleTo(e){let t=Math.sqrt(this.lengthSq()*e.lengthSq());if(t===0)return Math.PI/2;let i=this.dot(e)/t;return Math.acos(Be(i,-1,1))}distanceTo(e){return Math.sqrt(this.distanceToSquared(e))}distanceToSquared(e){let t=this.x-e.x,i=this.y-e.y,n=this.z-e.z;return t*t+i*i+n*n}manhattanDistanceTo(e){return Math.abs(this.x-e.x)+Math.abs(this.y-e.y)+Math.abs(this.z-e.z)}setFromSpherical(e){return this.setFromSphericalCoords(e.radius,e.phi,e.theta)}setFromSphericalCoords(e,t,i){let n=Math.sin(t)*e;return this.x=n*Math.sin(i),this.y=Math.cos(t)*e,this.z=n*Math.cos(i),this}setFromCylindrical(e){return this.setFromCylindricalCoords(e.radius,e.theta,e.y)}setFromCylindricalCoords(e,t,i){return this.x=e*Math.sin(t),this.y=i,this.z=e*Math.cos(t),this}setFromMatrixPosition(e){let t=e.elements;return this.x=t[12],this.y=t[13],this.z=t[14],this}setFromMatrixScale(e){let t=this.setFromMatrixColumn(e,0).length(),i=this.setFromMatrixColumn(e,1).length(),n=this.setFromMatrixColumn(e,2).length();return this.x=t,this.y=i,this.z=n,this}setFromMatrixColumn(e,t){return this.fromArray(e.elements,4*t)}setFromMatrix3Column(e,t){return this.fromArray(e.elements,3*t)}setFromEuler(e){return this.x=e._x,this.y=e._y,this.z=e._z,this}setFromColor(e){return this.x=e.r,this.y=e.g,this.z=e.b,this}equals(e){return e.x===this.x&&e.y===this.y&&e.z===this.z}fromArray(e,t=0){return this.x=e[t],this.y=e[t+1],this.z=e[t+2],this}toArray(e=[],t=0){return e[t]=this.x,e[t+1]=this.y,e[t+2]=this.z,e}fromBufferAttribute(e,t){return this.x=e.getX(t),this.y=e.getY(t),this.z=e.getZ(t),this}random(){return this.x=Math.random(),this.y=Math.random(),this.z=Math.random(),this}randomDirection(){let e=Math.random()*Math.PI*2,t=2*Math.random()-1,i=Math.sqrt(1-t*t);return this.x=i*Math.cos(e),this.y=t,this.z=i*Math.sin(e),this}*[Symbol.iterator](){yield this.x,yield this.y,yield this.z}},gl=new A,Fu=new ni,Ue=class r{static{r.prototype.isMatrix3=!0}constructor(e,t,i,n,s,a,o,l,c){this.elements=[1,0,0,0,1,0,0,0,1],e!==void 0&&this.set(e,t,i,n,s,a,o,l,c)}set(e,t,i,n,s,a,o,l,c){let h=this.elements;return h[0]=e,h[1]=n,h[2]=o,h[3]=t,h[4]=s,h[5]=l,h[6]=i,h[7]=a,h[8]=c,this}identity(){return this.set(1,0,0,0,1,0,0,0,1),this}copy(e){let t=this.elements,i=e.elements;return t[0]=i[0],t[1]=i[1],t[2]=i[2],t[3]=i[3],t[4]=i[4],t[5]=i[5],t[6]=i[6],t[7]=i[7],t[8]=i[8],this}extractBasis(e,t,i){return e.setFromMatrix3Column(this,0),t.setFromMatrix3Column(this,1),i.setFromMatrix3Column(this,2),this}setFromMatrix4(e){let t=e.elements;return this.set(t[0],t[4],t[8],t[1],t[5],t[9],t[2],t[6],t[10]),this}multiply(e){return this.multiplyMatrices(this,e)}premultiply(e){return this.multiplyMatrices(e,this)}multiplyMatrices(e,t){let i=e.elements,n=t.elements,s=this.elements,a=i[0],o=i[3],l=i[6],c=i[1],h=i[4],u=i[7],f=i[2],p=i[5],g=i[8],d=n[0],_=n[3],m=n[6],v=n[1],y=n[4],w=n[7],E=n[2],M=n[5],D=n[8];return s[0]=a*d+o*v+l*E,s[3]=a*_+o*y+l*M,s[6]=a*m+o*w+l*D,s[1]=c*d+h*v+u*E,s[4]=c*_+h*y+u*M,s[7]=c*m+h*w+u*D,s[2]=f*d+p*v+g*E,s[5]=f*_+p*y+g*M,s[8]=f*m+p*w+g*D,this}multiplyScalar(e){let t=this.elements;return t[0]*=e,t[3]*=e,t[6]*=e,t[1]*=e,t[4]*=e,t[7]*=e,t[2]*=e,t[5]*=e,t[8]*=e,this}determinant(){let e=this.elements,t=e[0],i=e[1],n=e[2],s=e[3],a=e[4],o=e[5],l=e[6],c=e[7],h=e[8];return t*a*h-t*o*c-i*s*h+i*o*l+n*s*c-n*a*l}invert(){let e=this.elements,t=e[0],i=e[1],n=e[2],s=e[3],a=e[4],o=e[5],l=e[6],c=e[7],h=e[8],u=h*a-o*c,f=o*l-h*s,p=c*s-a*l,g=t*u+i*f+n*p;if(g===0)return this.set(0,0,0,0,0,0,0,0,0);let d=1/g;return e[0]=u*d,e[1]=(n*c-h*i)*d,e[2]=(o*i-n*a)*d,e[3]=f*d,e[4]=(h*t-n*l)*d,e[5]=(n*s-o*t)*d,e[6]=p*d,e[7]=(i*l-c*t)*d,e[8]=(a*t-i*s)*d,this}transpose(){let e,t=this.elements;return e=t[1],t[1]=t[3],t[3]=e,e=t[2],t[2]=t[6],t[6]=e,e=t[5],t[5]=t[7],t[7]=e,this}getNormalMatrix(e){return this.setFromMatrix4(e).invert().transpose()}transposeIntoArray(e){let t=this.elements;return e[0]=t[0],e[1]=t[3],e[2]=t[6],e[3]=t[1],e[4]=t[4],e[5]=t[7],e[6]=t[2],e[7]=t[5],e[8]=t[8],this}setUvTransform(e,t,i,n,s,a,o){let l=Math.cos(s),c=Math.sin(s);return this.set(i*l,i*c,-i*(l*a+c*o)+a+e,-n*c,n*l,-n*(-c*a+l*o)+o+t,0,0,1),this}scale(e,t){return this.premultiply(vl.makeScale(e,t)),this}rotate(e){return this.premultiply(vl.makeRotation(-e)),this}translate(e,t){return this.premultiply(vl.makeTranslation(e,t)),this}makeTranslation(e,t){return e.isVector2?this.set(1,0,e.x,0,1,e.y,0,0,1):this.set(1,0,e,0,1,t,0,0,1),this}makeRotation(e){let t=Math.cos(e),i=Math.sin(e);return this.set(t,-i,0,i,t,0,0,0,1),this}makeScale(e,t){return this.set(e,0,0,0,t,0,0,0,1),this}equals(e){let t=this.elements,i=e.elements;for(let n=0;n<9;n++)if(t[n]!==i[n])return!1;return!0}fromArray(e,t=0){for(let i=0;i<9;i++)this.elements[i]=e[i+t];return this}toArray(e=[],t=0){let i=this.elements;return e[t]=i[0],e[t+1]=i[1],e[t+2]=i[2],e[t+3]=i[3],e[t+4]=i[4],e[t+5]=i[5],e[t+6]=i[6],e[t+7]=i[7],e[t+8]=i[8],e}clone(){return new this.constructor().fromArray(this.elements)}},vl=new Ue,Ou=new Ue().set(.4123908,.3575843,.1804808,.212639,.7151687,.0721923,.0193308,.1191948,.9505322),Bu=new Ue().set(3.2409699,-1.5373832,-.4986108,-.9692436,1.8759675,.0415551,.0556301,-.203977,1.0569715);function Mm(){let r={enabled:!0,workingColorSpace:Br,spaces:{},convert:function(n,s,a){return this.enabled!==!1&&s!==a&&s&&a&&(this.spaces[s].transfer===Ke&&(n.r=ki(n.r),n.g=ki(n.g),n.b=ki(n.b)),this.spaces[s].primaries!==this.spaces[a].primaries&&(n.applyMatrix3(this.spaces[s].toXYZ),n.applyMatrix3(this.spaces[a].fromXYZ)),this.spaces[a].transfer===Ke&&(n.r=ir(n.r),n.g=ir(n.g),n.b=ir(n.b))),n},workingToColorSpace:function(n,s){return this.convert(n,this.workingColorSpace,s)},colorSpaceToWorking:function(n,s){return this.convert(n,s,this.workingColorSpace)},getPrimaries:function(n){return this.spaces[n].primaries},getTransfer:function(n){return n===""?kr:this.spaces[n].transfer},getToneMappingMode:function(n){return this.spaces[n].outputColorSpaceConfig.toneMappingMode||"standard"},getLuminanceCoefficients:function(n,s=this.workingColorSpace){return n.fromArray(this.spaces[s].luminanceCoefficients)},define:function(n){Object.assign(this.spaces,n)},_getMatrix:function(n,s,a){return n.copy(this.spaces[s].toXYZ).multiply(this.spaces[a].fromXYZ)},_getDrawingBufferColorSpace:function(n){return this.spaces[n].outputColorSpaceConfig.drawingBufferColorSpace},_getUnpackColorSpace:function(n=this.workingColorSpace){return this.spaces[n].workingColorSpaceConfig.unpackColorSpace},fromWorkingColorSpace:function(n,s){return _a("ColorManagement: .fromWorkingColorSpace() has been renamed to .workingToColorSpace()."),r.workingToColorSpace(n,s)},toWorkingColorSpace:function(n,s){return _a("ColorManagement: .toWorkingColorSpace() has been renamed to .colorSpaceToWorking()."),r.colorSpaceToWorking(n,s)}},e=[.64,.33,.3,.6,.15,.06],t=[.2126,.7152,.0722],i=[.3127,.329];return r.define({[Br]:{primaries:e,whitePoint:i,transfer:kr,toXYZ:Ou,fromXYZ:Bu,luminanceCoefficients:t,workingColorSpaceConfig:{unpackColorSpace:Yt},outputColorSpaceConfig:{drawingBufferColorSpace:Yt}},[Yt]:{primaries:e,whitePoint:i,transfer:Ke,toXYZ:Ou,fromXYZ:Bu,luminanceCoefficients:t,outputColorSpaceConfig:{drawingBufferColorSpace:Yt}}}),r}var Ve=Mm();function ki(r){return r<.04045?.0773993808*r:Math.pow(.9478672986*r+.0521327014,2.4)}function ir(r){return r<.0031308?12.92*r:1.055*Math.pow(r,.41666)-.055}var Xn,ya=class{static getDataURL(e,t="image/png"){if(/^data:/i.test(e.src)||typeof HTMLCanvasElement>"u")return e.src;let i;if(e instanceof HTMLCanvasElement)i=e;else{Xn===void 0&&(Xn=Gr("canvas")),Xn.width=e.width,Xn.height=e.height;let n=Xn.getContext("2d");e instanceof ImageData?n.putImageData(e,0,0):n.drawImage(e,0,0,e.width,e.height),i=Xn}return i.toDataURL(t)}static sRGBToLinear(e){if(typeof HTMLImageElement<"u"&&e instanceof HTMLImageElement||typeof HTMLCanvasElement<"u"&&e instanceof HTMLCanvasElement||typeof ImageBitmap<"u"&&e instanceof ImageBitmap){let t=Gr("canvas");t.width=e.width,t.height=e.height;let i=t.getContext("2d");i.drawImage(e,0,0,e.width,e.height);let n=i.getImageData(0,0,e.width,e.height),s=n.data;for(let a=0;a<s.length;a++)s[a]=255*ki(s[a]/255);return i.putImageData(n,0,0),t}if(e.data){let t=e.data.slice(0);for(let i=0;i<t.length;i++)t instanceof Uint8Array||t instanceof Uint8ClampedArray?t[i]=Math.floor(255*ki(t[i]/255)):t[i]=ki(t[i]);return{data:t,width:e.width,height:e.height}}return we("ImageUtils.sRGBToLinear(): Unsupported image type. No color space conversion applied."),e}},Sm=0,rr=class{constructor(e=null){this.isSource=!0,Object.defineProperty(this,"id",{value:Sm++}),this.uuid=gr(),this.data=e,this.dataReady=!0,this.version=0}getSize(e){let t=this.data;return typeof HTMLVideoElement<"u"&&t instanceof HTMLVideoElement?e.set(t.videoWidth,t.videoHeight,0):typeof VideoFrame<"u"&&t instanceof VideoFrame?e.set(t.displayWidth,t.displayHeight,0):t!==null?e.set(t.width,t.height,t.depth||0):e.set(0,0,0),e}set needsUpdate(e){e===!0&&this.version++}toJSON(e){let t=e===void 0||typeof e=="string";if(!t&&e.images[this.uuid]!==void 0)return e.images[this.uuid];let i={uuid:this.uuid,url:""},n=this.data;if(n!==null){let s;if(Array.isArray(n)){s=[];for(let a=0,o=n.length;a<o;a++)n[a].isDataTexture?s.push(_l(n[a].image)):s.push(_l(n[a]))}else s=_l(n);i.url=s}return t||(e.images[this.uuid]=i),i}};function _l(r){return typeof HTMLImageElement<"u"&&r instanceof HTMLImageElement||typeof HTMLCanvasElement<"u"&&r instanceof HTMLCanvasElement||typeof ImageBitmap<"u"&&r instanceof ImageBitmap?ya.getDataURL(r):r.data?{data:Array.from(r.data),width:r.width,height:r.height,type:r.data.constructor.name}:(we("Texture: Unable to serialize Texture."),{})}var bm=0,xl=new A,Dt=class r extends Ei{constructor(e=r.DEFAULT_IMAGE,t=r.DEFAULT_MAPPING,i=1001,n=1001,s=1006,a=1008,o=1023,l=1009,c=r.DEFAULT_ANISOTROPY,h=""){super(),this.isTexture=!0,Object.defineProperty(this,"id",{value:bm++}),this.uuid=gr(),this.name="",this.source=new rr(e),this.mipmaps=[],this.mapping=t,this.channel=0,this.wrapS=i,this.wrapT=n,this.magFilter=s,this.minFilter=a,this.anisotropy=c,this.format=o,this.internalFormat=null,this.type=l,this.offset=new ne(0,0),this.repeat=new ne(1,1),this.center=new ne(0,0),this.rotation=0,this.matrixAutoUpdate=!0,this.matrix=new Ue,this.generateMipmaps=!0,this.premultiplyAlpha=!1,this.flipY=!0,this.unpackAlignment=4,this.colorSpace=h,this.userData={},this.updateRanges=[],this.version=0,this.onUpdate=null,this.renderTarget=null,this.isRenderTargetTexture=!1,this.isArrayTexture=!!(e&&e.depth&&e.depth>1),this.pmremVersion=0,this.normalized=!1}get width(){return this.source.getSize(xl).x}get height(){return this.source.getSize(xl).y}get depth(){return this.source.getSize(xl).z}get image(){return this.source.data}set image(e){this.source.data=e}updateMatrix(){this.matrix.setUvTransform(this.offset.x,this.offset.y,this.repeat.x,this.repeat.y,this.rotation,this.center.x,this.center.y)}addUpdateRange(e,t){this.updateRanges.push({start:e,count:t})}clearUpdateRanges(){this.updateRanges.length=0}clone(){return new this.constructor().copy(this)}copy(e){return this.name=e.name,this.source=e.source,this.mipmaps=e.mipmaps.slice(0),this.mapping=e.mapping,this.channel=e.channel,this.wrapS=e.wrapS,this.wrapT=e.wrapT,this.magFilter=e.magFilter,this.minFilter=e.minFilter,this.anisotropy=e.anisotropy,this.format=e.format,this.internalFormat=e.internalFormat,this.type=e.type,this.normalized=e.normalized,this.offset.copy(e.offset),this.repeat.copy(e.repeat),this.center.copy(e.center),this.rotation=e.rotation,this.matrixAutoUpdate=e.matrixAutoUpdate,this.matrix.copy(e.matrix),this.generateMipmaps=e.generateMipmaps,this.premultiplyAlpha=e.premultiplyAlpha,this.flipY=e.flipY,this.unpackAlignment=e.unpackAlignment,this.colorSpace=e.colorSpace,this.renderTarget=e.renderTarget,this.isRenderTargetTexture=e.isRenderTargetTexture,this.isArrayTexture=e.isArrayTexture,this.userData=JSON.parse(JSON.stringify(e.userData)),this.needsUpdate=!0,this}setValues(e){for(let t in e){let i=e[t];if(i===void 0){we(`Texture.setValues(): parameter '${t}' has value of undefined.`);continue}let n=this[t];n!==void 0?n&&i&&n.isVector2&&i.isVector2||n&&i&&n.isVector3&&i.isVector3||n&&i&&n.isMatrix3&&i.isMatrix3?n.copy(i):this[t]=i:we(`Texture.setValues(): property '${t}' does not exist.`)}}toJSON(e){let t=e===void 0||typeof e=="string";if(!t&&e.textures[this.uuid]!==void 0)return e.textures[this.uuid];let i={metadata:{version:4.7,type:"Texture",generator:"Texture.toJSON"},uuid:this.uuid,name:this.name,image:this.source.toJSON(e).uuid,mapping:this.mapping,channel:this.channel,repeat:[this.repeat.x,this.repeat.y],offset:[this.offset.x,this.offset.y],center:[this.center.x,this.center.y],rotation:this.rotation,wrap:[this.wrapS,this.wrapT],format:this.format,internalFormat:this.internalFormat,type:this.type,normalized:this.normalized,colorSpace:this.colorSpace,minFilter:this.minFilter,magFilter:this.magFilter,anisotropy:this.anisotropy,flipY:this.flipY,generateMipmaps:this.generateMipmaps,premultiplyAlpha:this.premultiplyAlpha,unpackAlignment:this.unpackAlignment};return Object.keys(this.userData).length>0&&(i.userData=this.userData),t||(e.textures[this.uuid]=i),i}dispose(){this.dispatchEvent({type:"dispose"})}transformUv(e){if(this.mapping!==gc)return e;if(e.applyMatrix3(this.matrix),e.x<0||e.x>1)switch(this.wrapS){case ma:e.x=e.x-Math.floor(e.x);break;case di:e.x=e.x<0?0:1;break;case ga:Math.abs(Math.floor(e.x)%2)===1?e.x=Math.ceil(e.x)-e.x:e.x=e.x-Math.floor(e.x)}if(e.y<0||e.y>1)switch(this.wrapT){case ma:e.y=e.y-Math.floor(e.y);break;case di:e.y=e.y<0?0:1;break;case ga:Math.abs(Math.floor(e.y)%2)===1?e.y=Math.ceil(e.y)-e.y:e.y=e.y-Math.floor(e.y)}return this.flipY&&(e.y=1-e.y),e}set needsUpdate(e){e===!0&&(this.version++,this.source.needsUpdate=!0)}set needsPMREMUpdate(e){e===!0&&this.pmremVersion++}};Dt.DEFAULT_IMAGE=null,Dt.DEFAULT_MAPPING=gc,Dt.DEFAULT_ANISOTROPY=1;var $e=class r{static{r.prototype.isVector4=!0}constructor(e=0,t=0,i=0,n=1){this.x=e,this.y=t,this.z=i,this.w=n}get width(){return this.z}set width(e){this.z=e}get height(){return this.w}set height(e){this.w=e}set(e,t,i,n){return this.x=e,this.y=t,this.z=i,this.w=n,this}setScalar(e){return this.x=e,this.y=e,this.z=e,this.w=e,this}setX(e){return this.x=e,this}setY(e){return this.y=e,this}setZ(e){return this.z=e,this}setW(e){return this.w=e,this}setComponent(e,t){switch(e){case 0:this.x=t;break;case 1:this.y=t;break;case 2:this.z=t;break;case 3:this.w=t;break;default:throw new Error("index is out of range: "+e)}return this}getComponent(e){switch(e){case 0:return this.x;case 1:return this.y;case 2:return this.z;case 3:return this.w;default:throw new Error("index is out of range: "+e)}}clone(){return new this.constructor(this.x,this.y,this.z,this.w)}copy(e){return this.x=e.x,this.y=e.y,this.z=e.z,this.w=e.w!==void 0?e.w:1,this}add(e){return this.x+=e.x,this.y+=e.y,this.z+=e.z,this.w+=e.w,this}addScalar(e){return this.x+=e,this.y+=e,this.z+=e,this.w+=e,this}addVectors(e,t){return this.x=e.x+t.x,this.y=e.y+t.y,this.z=e.z+t.z,this.w=e.w+t.w,this}addScaledVector(e,t){return this.x+=e.x*t,this.y+=e.y*t,this.z+=e.z*t,this.w+=e.w*t,this}sub(e){return this.x-=e.x,this.y-=e.y,this.z-=e.z,this.w-=e.w,this}subScalar(e){return this.x-=e,this.y-=e,this.z-=e,this.w-=e,this}subVectors(e,t){return this.x=e.x-t.x,this.y=e.y-t.y,this.z=e.z-t.z,this.w=e.w-t.w,this}multiply(e){return this.x*=e.x,this.y*=e.y,this.z*=e.z,this.w*=e.w,this}multiplyScalar(e){return this.x*=e,this.y*=e,this.z*=e,this.w*=e,this}applyMatrix4(e){let t=this.x,i=this.y,n=this.z,s=this.w,a=e.elements;return this.x=a[0]*t+a[4]*i+a[8]*n+a[12]*s,this.y=a[1]*t+a[5]*i+a[9]*n+a[13]*s,this.z=a[2]*t+a[6]*i+a[10]*n+a[14]*s,this.w=a[3]*t+a[7]*i+a[11]*n+a[15]*s,this}divide(e){return this.x/=e.x,this.y/=e.y,this.z/=e.z,this.w/=e.w,this}divideScalar(e){return this.multiplyScalar(1/e)}setAxisAngleFromQuaternion(e){this.w=2*Math.acos(e.w);let t=Math.sqrt(1-e.w*e.w);return t<1e-4?(this.x=1,this.y=0,this.z=0):(this.x=e.x/t,this.y=e.y/t,this.z=e.z/t),this}setAxisAngleFromRotationMatrix(e){let t,i,n,s,l=e.elements,c=l[0],h=l[4],u=l[8],f=l[1],p=l[5],g=l[9],d=l[2],_=l[6],m=l[10];if(Math.abs(h-f)<.01&&Math.abs(u-d)<.01&&Math.abs(g-_)<.01){if(Math.abs(h+f)<.1&&Math.abs(u+d)<.1&&Math.abs(g+_)<.1&&Math.abs(c+p+m-3)<.1)return this.set(1,0,0,0),this;t=Math.PI;let y=(c+1)/2,w=(p+1)/2,E=(m+1)/2,M=(h+f)/4,D=(u+d)/4,F=(g+_)/4;return y>w&&y>E?y<.01?(i=0,n=.707106781,s=.707106781):(i=Math.sqrt(y),n=M/i,s=D/i):w>E?w<.01?(i=.707106781,n=0,s=.707106781):(n=Math.sqrt(w),i=M/n,s=F/n):E<.01?(i=.707106781,n=.707106781,s=0):(s=Math.sqrt(E),i=D/s,n=F/s),this.set(i,n,s,t),this}let v=Math.sqrt((_-g)*(_-g)+(u-d)*(u-d)+(f-h)*(f-h));return Math.abs(v)<.001&&(v=1),this.x=(_-g)/v,this.y=(u-d)/v,this.z=(f-h)/v,this.w=Math.acos((c+p+m-1)/2),this}setFromMatrixPosition(e){let t=e.elements;return this.x=t[12],this.y=t[13],this.z=t[14],this.w=t[15],this}min(e){return this.x=Math.min(this.x,e.x),this.y=Math.min(this.y,e.y),this.z=Math.min(this.z,e.z),this.w=Math.min(this.w,e.w),this}max(e){return this.x=Math.max(this.x,e.x),this.y=Math.max(this.y,e.y),this.z=Math.max(this.z,e.z),this.w=Math.max(this.w,e.w),this}clamp(e,t){return this.x=Be(this.x,e.x,t.x),this.y=Be(this.y,e.y,t.y),this.z=Be(this.z,e.z,t.z),this.w=Be(this.w,e.w,t.w),this}clampScalar(e,t){return this.x=Be(this.x,e,t),this.y=Be(this.y,e,t),this.z=Be(this.z,e,t),this.w=Be(this.w,e,t),this}clampLength(e,t){let i=this.length();return this.divideScalar(i||1).multiplyScalar(Be(i,e,t))}floor(){return this.x=Math.floor(this.x),this.y=Math.floor(this.y),this.z=Math.floor(this.z),this.w=Math.floor(this.w),this}ceil(){return this.x=Math.ceil(this.x),this.y=Math.ceil(this.y),this.z=Math.ceil(this.z),this.w=Math.ceil(this.w),this}round(){return this.x=Math.round(this.x),this.y=Math.round(this.y),this.z=Math.round(this.z),this.w=Math.round(this.w),this}roundToZero(){return this.x=Math.trunc(this.x),this.y=Math.trunc(this.y),this.z=Math.trunc(this.z),this.w=Math.trunc(this.w),this}negate(){return this.x=-this.x,this.y=-this.y,this.z=-this.z,this.w=-this.w,this}dot(e){return this.x*e.x+this.y*e.y+this.z*e.z+this.w*e.w}lengthSq(){return this.x*this.x+this.y*this.y+this.z*this.z+this.w*this.w}length(){return Math.sqrt(this.x*this.x+this.y*this.y+this.z*this.z+this.w*this.w)}manhattanLength(){return Math.abs(this.x)+Math.abs(this.y)+Math.abs(this.z)+Math.abs(this.w)}normalize(){return this.divideScalar(this.length()||1)}setLength(e){return this.normalize().multiplyScalar(e)}lerp(e,t){return this.x+=(e.x-this.x)*t,this.y+=(e.y-this.y)*t,this.z+=(e.z-this.z)*t,this.w+=(e.w-this.w)*t,this}lerpVectors(e,t,i){return this.x=e.x+(t.x-e.x)*i,this.y=e.y+(t.y-e.y)*i,this.z=e.z+(t.z-e.z)*i,this.w=e.w+(t.w-e.w)*i,this}equals(e){return e.x===this.x&&e.y===this.y&&e.z===this.z&&e.w===this.w}fromArray(e,t=0){return this.x=e[t],this.y=e[t+1],this.z=e[t+2],this.w=e[t+3],this}toArray(e=[],t=0){return e[t]=this.x,e[t+1]=this.y,e[t+2]=this.z,e[t+3]=this.w,e}fromBufferAttribute(e,t){return this.x=e.getX(t),this.y=e.getY(t),this.z=e.getZ(t),this.w=e.getW(t),this}random(){return this.x=Math.random(),this.y=Math.random(),this.z=Math.random(),this.w=Math.random(),this}*[Symbol.iterator](){yield this.x,yield this.y,yield this.z,yield this.w}},Ma=class extends Ei{constructor(e=1,t=1,i={}){super(),i=Object.assign({generateMipmaps:!1,internalFormat:null,minFilter:wt,depthBuffer:!0,stencilBuffer:!1,resolveDepthBuffer:!0,resolveStencilBuffer:!0,depthTexture:null,samples:0,count:1,depth:1,multiview:!1},i),this.isRenderTarget=!0,this.width=e,this.height=t,this.depth=i.depth,this.scissor=new $e(0,0,e,t),this.scissorTest=!1,this.viewport=new $e(0,0,e,t),this.textures=[];let n={width:e,height:t,depth:i.depth},s=new Dt(n),a=i.count;for(let o=0;o<a;o++)this.textures[o]=s.clone(),this.textures[o].isRenderTargetTexture=!0,this.textures[o].renderTarget=this;this._setTextureOptions(i),this.depthBuffer=i.depthBuffer,this.stencilBuffer=i.stencilBuffer,this.resolveDepthBuffer=i.resolveDepthBuffer,this.resolveStencilBuffer=i.resolveStencilBuffer,this._depthTexture=null,this.depthTexture=i.depthTexture,this.samples=i.samples,this.multiview=i.multiview}_setTextureOptions(e={}){let t={minFilter:wt,generateMipmaps:!1,flipY:!1,internalFormat:null};e.mapping!==void 0&&(t.mapping=e.mapping),e.wrapS!==void 0&&(t.wrapS=e.wrapS),e.wrapT!==void 0&&(t.wrapT=e.wrapT),e.wrapR!==void 0&&(t.wrapR=e.wrapR),e.magFilter!==void 0&&(t.magFilter=e.magFilter),e.minFilter!==void 0&&(t.minFilter=e.minFilter),e.format!==void 0&&(t.format=e.format),e.type!==void 0&&(t.type=e.type),e.anisotropy!==void 0&&(t.anisotropy=e.anisotropy),e.colorSpace!==void 0&&(t.colorSpace=e.colorSpace),e.flipY!==void 0&&(t.flipY=e.flipY),e.generateMipmaps!==void 0&&(t.generateMipmaps=e.generateMipmaps),e.internalFormat!==void 0&&(t.internalFormat=e.internalFormat);for(let i=0;i<this.textures.length;i++)this.textures[i].setValues(t)}get texture(){return this.textures[0]}set texture(e){this.textures[0]=e}set depthTexture(e){this._depthTexture!==null&&(this._depthTexture.renderTarget=null),e!==null&&(e.renderTarget=this),this._depthTexture=e}get depthTexture(){return this._depthTexture}setSize(e,t,i=1){if(this.width!==e||this.height!==t||this.depth!==i){this.width=e,this.height=t,this.depth=i;for(let n=0,s=this.textures.length;n<s;n++)this.textures[n].image.width=e,this.textures[n].image.height=t,this.textures[n].image.depth=i,this.textures[n].isData3DTexture!==!0&&(this.textures[n].isArrayTexture=this.textures[n].image.depth>1);this.dispose()}this.viewport.set(0,0,e,t),this.scissor.set(0,0,e,t)}clone(){return new this.constructor().copy(this)}copy(e){this.width=e.width,this.height=e.height,this.depth=e.depth,this.scissor.copy(e.scissor),this.scissorTest=e.scissorTest,this.viewport.copy(e.viewport),this.textures.length=0;for(let t=0,i=e.textures.length;t<i;t++){this.textures[t]=e.textures[t].clone(),this.textures[t].isRenderTargetTexture=!0,this.textures[t].renderTarget=this;let n=Object.assign({},e.textures[t].image);this.textures[t].source=new rr(n)}return this.depthBuffer=e.depthBuffer,this.stencilBuffer=e.stencilBuffer,this.resolveDepthBuffer=e.resolveDepthBuffer,this.resolveStencilBuffer=e.resolveStencilBuffer,e.depthTexture!==null&&(this.depthTexture=e.depthTexture.clone()),this.samples=e.samples,this.multiview=e.multiview,this}dispose(){this.dispatchEvent({type:"dispose"})}},kt=class extends Ma{constructor(e=1,t=1,i={}){super(e,t,i),this.isWebGLRenderTarget=!0}},Vr=class extends Dt{constructor(e=null,t=1,i=1,n=1){super(null),this.isDataArrayTexture=!0,this.image={data:e,width:t,height:i,depth:n},this.magFilter=At,this.minFilter=At,this.wrapR=di,this.generateMipmaps=!1,this.flipY=!1,this.unpackAlignment=1,this.layerUpdates=new Set}addLayerUpdate(e){this.layerUpdates.add(e)}clearLayerUpdates(){this.layerUpdates.clear()}};var Sa=class extends Dt{constructor(e=null,t=1,i=1,n=1){super(null),this.isData3DTexture=!0,this.image={data:e,width:t,height:i,depth:n},this.magFilter=At,this.minFilter=At,this.wrapR=di,this.generateMipmaps=!1,this.flipY=!1,this.unpackAlignment=1}};var De=class r{static{r.prototype.isMatrix4=!0}constructor(e,t,i,n,s,a,o,l,c,h,u,f,p,g,d,_){this.elements=[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1],e!==void 0&&this.set(e,t,i,n,s,a,o,l,c,h,u,f,p,g,d,_)}set(e,t,i,n,s,a,o,l,c,h,u,f,p,g,d,_){let m=this.elements;return m[0]=e,m[4]=t,m[8]=i,m[12]=n,m[1]=s,m[5]=a,m[9]=o,m[13]=l,m[2]=c,m[6]=h,m[10]=u,m[14]=f,m[3]=p,m[7]=g,m[11]=d,m[15]=_,this}identity(){return this.set(1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1),this}clone(){return new r().fromArray(this.elements)}copy(e){let t=this.elements,i=e.elements;return t[0]=i[0],t[1]=i[1],t[2]=i[2],t[3]=i[3],t[4]=i[4],t[5]=i[5],t[6]=i[6],t[7]=i[7],t[8]=i[8],t[9]=i[9],t[10]=i[10],t[11]=i[11],t[12]=i[12],t[13]=i[13],t[14]=i[14],t[15]=i[15],this}copyPosition(e){let t=this.elements,i=e.elements;return t[12]=i[12],t[13]=i[13],t[14]=i[14],this}setFromMatrix3(e){let t=e.elements;return this.set(t[0],t[3],t[6],0,t[1],t[4],t[7],0,t[2],t[5],t[8],0,0,0,0,1),this}extractBasis(e,t,i){return this.determinant()===0?(e.set(1,0,0),t.set(0,1,0),i.set(0,0,1),this):(e.setFromMatrixColumn(this,0),t.setFromMatrixColumn(this,1),i.setFromMatrixColumn(this,2),this)}makeBasis(e,t,i){return this.set(e.x,t.x,i.x,0,e.y,t.y,i.y,0,e.z,t.z,i.z,0,0,0,0,1),this}extractRotation(e){if(e.determinant()===0)return this.identity();let t=this.elements,i=e.elements,n=1/jn.setFromMatrixColumn(e,0).length(),s=1/jn.setFromMatrixColumn(e,1).length(),a=1/jn.setFromMatrixColumn(e,2).length();return t[0]=i[0]*n,t[1]=i[1]*n,t[2]=i[2]*n,t[3]=0,t[4]=i[4]*s,t[5]=i[5]*s,t[6]=i[6]*s,t[7]=0,t[8]=i[8]*a,t[9]=i[9]*a,t[10]=i[10]*a,t[11]=0,t[12]=0,t[13]=0,t[14]=0,t[15]=1,this}makeRotationFromEuler(e){let t=this.elements,i=e.x,n=e.y,s=e.z,a=Math.cos(i),o=Math.sin(i),l=Math.cos(n),c=Math.sin(n),h=Math.cos(s),u=Math.sin(s);if(e.order==="XYZ"){let f=a*h,p=a*u,g=o*h,d=o*u;t[0]=l*h,t[4]=-l*u,t[8]=c,t[1]=p+g*c,t[5]=f-d*c,t[9]=-o*l,t[2]=d-f*c,t[6]=g+p*c,t[10]=a*l}else if(e.order==="YXZ"){let f=l*h,p=l*u,g=c*h,d=c*u;t[0]=f+d*o,t[4]=g*o-p,t[8]=a*c,t[1]=a*u,t[5]=a*h,t[9]=-o,t[2]=p*o-g,t[6]=d+f*o,t[10]=a*l}else if(e.order==="ZXY"){let f=l*h,p=l*u,g=c*h,d=c*u;t[0]=f-d*o,t[4]=-a*u,t[8]=g+p*o,t[1]=p+g*o,t[5]=a*h,t[9]=d-f*o,t[2]=-a*c,t[6]=o,t[10]=a*l}else if(e.order==="ZYX"){let f=a*h,p=a*u,g=o*h,d=o*u;t[0]=l*h,t[4]=g*c-p,t[8]=f*c+d,t[1]=l*u,t[5]=d*c+f,t[9]=p*c-g,t[2]=-c,t[6]=o*l,t[10]=a*l}else if(e.order==="YZX"){let f=a*l,p=a*c,g=o*l,d=o*c;t[0]=l*h,t[4]=d-f*u,t[8]=g*u+p,t[1]=u,t[5]=a*h,t[9]=-o*h,t[2]=-c*h,t[6]=p*u+g,t[10]=f-d*u}else if(e.order==="XZY"){let f=a*l,p=a*c,g=o*l,d=o*c;t[0]=l*h,t[4]=-u,t[8]=c*h,t[1]=f*u+d,t[5]=a*h,t[9]=p*u-g,t[2]=g*u-p,t[6]=o*h,t[10]=d*u+f}return t[3]=0,t[7]=0,t[11]=0,t[12]=0,t[13]=0,t[14]=0,t[15]=1,this}makeRotationFromQuaternion(e){return this.compose(wm,e,Tm)}lookAt(e,t,i){let n=this.elements;return jt.subVectors(e,t),jt.lengthSq()===0&&(jt.z=1),jt.normalize(),qi.crossVectors(i,jt),qi.lengthSq()===0&&(Math.abs(i.z)===1?jt.x+=1e-4:jt.z+=1e-4,jt.normalize(),qi.crossVectors(i,jt)),qi.normalize(),Vs.crossVectors(jt,qi),n[0]=qi.x,n[4]=Vs.x,n[8]=jt.x,n[1]=qi.y,n[5]=Vs.y,n[9]=jt.y,n[2]=qi.z,n[6]=Vs.z,n[10]=jt.z,this}multiply(e){return this.multiplyMatrices(this,e)}premultiply(e){return this.multiplyMatrices(e,this)}multiplyMatrices(e,t){let i=e.elements,n=t.elements,s=this.elements,a=i[0],o=i[4],l=i[8],c=i[12],h=i[1],u=i[5],f=i[9],p=i[13],g=i[2],d=i[6],_=i[10],m=i[14],v=i[3],y=i[7],w=i[11],E=i[15],M=n[0],D=n[4],F=n[8],I=n[12],P=n[1],H=n[5],O=n[9],j=n[13],z=n[2],k=n[6],q=n[10],X=n[14],oe=n[3],ue=n[7],be=n[11],ye=n[15];return s[0]=a*M+o*P+l*z+c*oe,s[4]=a*D+o*H+l*k+c*ue,s[8]=a*F+o*O+l*q+c*be,s[12]=a*I+o*j+l*X+c*ye,s[1]=h*M+u*P+f*z+p*oe,s[5]=h*D+u*H+f*k+p*ue,s[9]=h*F+u*O+f*q+p*be,s[13]=h*I+u*j+f*X+p*ye,s[2]=g*M+d*P+_*z+m*oe,s[6]=g*D+d*H+_*k+m*ue,s[10]=g*F+d*O+_*q+m*be,s[14]=g*I+d*j+_*X+m*ye,s[3]=v*M+y*P+w*z+E*oe,s[7]=v*D+y*H+w*k+E*ue,s[11]=v*F+y*O+w*q+E*be,s[15]=v*I+y*j+w*X+E*ye,this}multiplyScalar(e){let t=this.elements;return t[0]*=e,t[4]*=e,t[8]*=e,t[12]*=e,t[1]*=e,t[5]*=e,t[9]*=e,t[13]*=e,t[2]*=e,t[6]*=e,t[10]*=e,t[14]*=e,t[3]*=e,t[7]*=e,t[11]*=e,t[15]*=e,this}determinant(){let e=this.elements,t=e[0],i=e[4],n=e[8],s=e[12],a=e[1],o=e[5],l=e[9],c=e[13],h=e[2],u=e[6],f=e[10],p=e[14],g=e[3],d=e[7],_=e[11],m=e[15],v=l*p-c*f,y=o*p-c*u,w=o*f-l*u,E=a*p-c*h,M=a*f-l*h,D=a*u-o*h;return t*(d*v-_*y+m*w)-i*(g*v-_*E+m*M)+n*(g*y-d*E+m*D)-s*(g*w-d*M+_*D)}transpose(){let e=this.elements,t;return t=e[1],e[1]=e[4],e[4]=t,t=e[2],e[2]=e[8],e[8]=t,t=e[6],e[6]=e[9],e[9]=t,t=e[3],e[3]=e[12],e[12]=t,t=e[7],e[7]=e[13],e[13]=t,t=e[11],e[11]=e[14],e[14]=t,this}setPosition(e,t,i){let n=this.elements;return e.isVector3?(n[12]=e.x,n[13]=e.y,n[14]=e.z):(n[12]=e,n[13]=t,n[14]=i),this}invert(){let e=this.elements,t=e[0],i=e[1],n=e[2],s=e[3],a=e[4],o=e[5],l=e[6],c=e[7],h=e[8],u=e[9],f=e[10],p=e[11],g=e[12],d=e[13],_=e[14],m=e[15],v=t*o-i*a,y=t*l-n*a,w=t*c-s*a,E=i*l-n*o,M=i*c-s*o,D=n*c-s*l,F=h*d-u*g,I=h*_-f*g,P=h*m-p*g,H=u*_-f*d,O=u*m-p*d,j=f*m-p*_,z=v*j-y*O+w*H+E*P-M*I+D*F;if(z===0)return this.set(0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0);let k=1/z;return e[0]=(o*j-l*O+c*H)*k,e[1]=(n*O-i*j-s*H)*k,e[2]=(d*D-_*M+m*E)*k,e[3]=(f*M-u*D-p*E)*k,e[4]=(l*P-a*j-c*I)*k,e[5]=(t*j-n*P+s*I)*k,e[6]=(_*w-g*D-m*y)*k,e[7]=(h*D-f*w+p*y)*k,e[8]=(a*O-o*P+c*F)*k,e[9]=(i*P-t*O-s*F)*k,e[10]=(g*M-d*w+m*v)*k,e[11]=(u*w-h*M-p*v)*k,e[12]=(o*I-a*H-l*F)*k,e[13]=(t*H-i*I+n*F)*k,e[14]=(d*y-g*E-_*v)*k,e[15]=(h*E-u*y+f*v)*k,this}scale(e){let t=this.elements,i=e.x,n=e.y,s=e.z;return t[0]*=i,t[4]*=n,t[8]*=s,t[1]*=i,t[5]*=n,t[9]*=s,t[2]*=i,t[6]*=n,t[10]*=s,t[3]*=i,t[7]*=n,t[11]*=s,this}getMaxScaleOnAxis(){let e=this.elements,t=e[0]*e[0]+e[1]*e[1]+e[2]*e[2],i=e[4]*e[4]+e[5]*e[5]+e[6]*e[6],n=e[8]*e[8]+e[9]*e[9]+e[10]*e[10];return Math.sqrt(Math.max(t,i,n))}makeTranslation(e,t,i){return e.isVector3?this.set(1,0,0,e.x,0,1,0,e.y,0,0,1,e.z,0,0,0,1):this.set(1,0,0,e,0,1,0,t,0,0,1,i,0,0,0,1),this}makeRotationX(e){let t=Math.cos(e),i=Math.sin(e);return this.set(1,0,0,0,0,t,-i,0,0,i,t,0,0,0,0,1),this}makeRotationY(e){let t=Math.cos(e),i=Math.sin(e);return this.set(t,0,i,0,0,1,0,0,-i,0,t,0,0,0,0,1),this}makeRotationZ(e){let t=Math.cos(e),i=Math.sin(e);return this.set(t,-i,0,0,i,t,0,0,0,0,1,0,0,0,0,1),this}makeRotationAxis(e,t){let i=Math.cos(t),n=Math.sin(t),s=1-i,a=e.x,o=e.y,l=e.z,c=s*a,h=s*o;return this.set(c*a+i,c*o-n*l,c*l+n*o,0,c*o+n*l,h*o+i,h*l-n*a,0,c*l-n*o,h*l+n*a,s*l*l+i,0,0,0,0,1),this}makeScale(e,t,i){return this.set(e,0,0,0,0,t,0,0,0,0,i,0,0,0,0,1),this}makeShear(e,t,i,n,s,a){return this.set(1,i,s,0,e,1,a,0,t,n,1,0,0,0,0,1),this}compose(e,t,i){let n=this.elements,s=t._x,a=t._y,o=t._z,l=t._w,c=s+s,h=a+a,u=o+o,f=s*c,p=s*h,g=s*u,d=a*h,_=a*u,m=o*u,v=l*c,y=l*h,w=l*u,E=i.x,M=i.y,D=i.z;return n[0]=(1-(d+m))*E,n[1]=(p+w)*E,n[2]=(g-y)*E,n[3]=0,n[4]=(p-w)*M,n[5]=(1-(f+m))*M,n[6]=(_+v)*M,n[7]=0,n[8]=(g+y)*D,n[9]=(_-v)*D,n[10]=(1-(f+d))*D,n[11]=0,n[12]=e.x,n[13]=e.y,n[14]=e.z,n[15]=1,this}decompose(e,t,i){let n=this.elements;e.x=n[12],e.y=n[13],e.z=n[14];let s=this.determinant();if(s===0)return i.set(1,1,1),t.identity(),this;let a=jn.set(n[0],n[1],n[2]).length(),o=jn.set(n[4],n[5],n[6]).length(),l=jn.set(n[8],n[9],n[10]).length();s<0&&(a=-a),ci.copy(this);let c=1/a,h=1/o,u=1/l;return ci.elements[0]*=c,ci.elements[1]*=c,ci.elements[2]*=c,ci.elements[4]*=h,ci.elements[5]*=h,ci.elements[6]*=h,ci.elements[8]*=u,ci.elements[9]*=u,ci.elements[10]*=u,t.setFromRotationMatrix(ci),i.x=a,i.y=o,i.z=l,this}makePerspective(e,t,i,n,s,a,o=2e3,l=!1){let c=this.elements,h=2*s/(t-e),u=2*s/(i-n),f=(t+e)/(t-e),p=(i+n)/(i-n),g,d;if(l)g=s/(a-s),d=a*s/(a-s);else if(o===zi)g=-(a+s)/(a-s),d=-2*a*s/(a-s);else{if(o!==zr)throw new Error("THREE.Matrix4.makePerspective(): Invalid coordinate system: "+o);g=-a/(a-s),d=-a*s/(a-s)}return c[0]=h,c[4]=0,c[8]=f,c[12]=0,c[1]=0,c[5]=u,c[9]=p,c[13]=0,c[2]=0,c[6]=0,c[10]=g,c[14]=d,c[3]=0,c[7]=0,c[11]=-1,c[15]=0,this}makeOrthographic(e,t,i,n,s,a,o=2e3,l=!1){let c=this.elements,h=2/(t-e),u=2/(i-n),f=-(t+e)/(t-e),p=-(i+n)/(i-n),g,d;if(l)g=1/(a-s),d=a/(a-s);else if(o===zi)g=-2/(a-s),d=-(a+s)/(a-s);else{if(o!==zr)throw new Error("THREE.Matrix4.makeOrthographic(): Invalid coordinate system: "+o);g=-1/(a-s),d=-s/(a-s)}return c[0]=h,c[4]=0,c[8]=0,c[12]=f,c[1]=0,c[5]=u,c[9]=0,c[13]=p,c[2]=0,c[6]=0,c[10]=g,c[14]=d,c[3]=0,c[7]=0,c[11]=0,c[15]=1,this}equals(e){let t=this.elements,i=e.elements;for(let n=0;n<16;n++)if(t[n]!==i[n])return!1;return!0}fromArray(e,t=0){for(let i=0;i<16;i++)this.elements[i]=e[i+t];return this}toArray(e=[],t=0){let i=this.elements;return e[t]=i[0],e[t+1]=i[1],e[t+2]=i[2],e[t+3]=i[3],e[t+4]=i[4],e[t+5]=i[5],e[t+6]=i[6],e[t+7]=i[7],e[t+8]=i[8],e[t+9]=i[9],e[t+10]=i[10],e[t+11]=i[11],e[t+12]=i[12],e[t+13]=i[13],e[t+14]=i[14],e[t+15]=i[15],e}},jn=new A,ci=new De,wm=new A(0,0,0),Tm=new A(1,1,1),qi=new A,Vs=new A,jt=new A,ku=new De,zu=new ni,tn=class r{constructor(e=0,t=0,i=0,n=r.DEFAULT_ORDER){this.isEuler=!0,this._x=e,this._y=t,this._z=i,this._order=n}get x(){return this._x}set x(e){this._x=e,this._onChangeCallback()}get y(){return this._y}set y(e){this._y=e,this._onChangeCallback()}get z(){return this._z}set z(e){this._z=e,this._onChangeCallback()}get order(){return this._order}set order(e){this._order=e,this._onChangeCallback()}set(e,t,i,n=this._order){return this._x=e,this._y=t,this._z=i,this._order=n,this._onChangeCallback(),this}clone(){return new this.constructor(this._x,this._y,this._z,this._order)}copy(e){return this._x=e._x,this._y=e._y,this._z=e._z,this._order=e._order,this._onChangeCallback(),this}setFromRotationMatrix(e,t=this._order,i=!0){let n=e.elements,s=n[0],a=n[4],o=n[8],l=n[1],c=n[5],h=n[9],u=n[2],f=n[6],p=n[10];switch(t){case"XYZ":this._y=Math.asin(Be(o,-1,1)),Math.abs(o)<.9999999?(this._x=Math.atan2(-h,p),this._z=Math.atan2(-a,s)):(this._x=Math.atan2(f,c),this._z=0);break;case"YXZ":this._x=Math.asin(-Be(h,-1,1)),Math.abs(h)<.9999999?(this._y=Math.atan2(o,p),this._z=Math.atan2(l,c)):(this._y=Math.atan2(-u,s),this._z=0);break;case"ZXY":this._x=Math.asin(Be(f,-1,1)),Math.abs(f)<.9999999?(this._y=Math.atan2(-u,p),this._z=Math.atan2(-a,c)):(this._y=0,this._z=Math.atan2(l,s));break;case"ZYX":this._y=Math.asin(-Be(u,-1,1)),Math.abs(u)<.9999999?(this._x=Math.atan2(f,p),this._z=Math.atan2(l,s)):(this._x=0,this._z=Math.atan2(-a,c));break;case"YZX":this._z=Math.asin(Be(l,-1,1)),Math.abs(l)<.9999999?(this._x=Math.atan2(-h,c),this._y=Math.atan2(-u,s)):(this._x=0,this._y=Math.atan2(o,p));break;case"XZY":this._z=Math.asin(-Be(a,-1,1)),Math.abs(a)<.9999999?(this._x=Math.atan2(f,c),this._y=Math.atan2(o,s)):(this._x=Math.atan2(-h,p),this._y=0);break;default:we("Euler: .setFromRotationMatrix() encountered an unknown order: "+t)}return this._order=t,i===!0&&this._onChangeCallback(),this}setFromQuaternion(e,t,i){return ku.makeRotationFromQuaternion(e),this.setFromRotationMatrix(ku,t,i)}setFromVector3(e,t=this._order){return this.set(e.x,e.y,e.z,t)}reorder(e){return zu.setFromEuler(this),this.setFromQuaternion(zu,e)}equals(e){return e._x===this._x&&e._y===this._y&&e._z===this._z&&e._order===this._order}fromArray(e){return this._x=e[0],this._y=e[1],this._z=e[2],e[3]!==void 0&&(this._order=e[3]),this._onChangeCallback(),this}toArray(e=[],t=0){return e[t]=this._x,e[t+1]=this._y,e[t+2]=this._z,e[t+3]=this._order,e}_onChange(e){return this._onChangeCallback=e,this}_onChangeCallback(){}*[Symbol.iterator](){yield this._x,yield this._y,yield this._z,yield this._order}};tn.DEFAULT_ORDER="XYZ";var Hr=class{constructor(){this.mask=1}set(e){this.mask=1<<e>>>0}enable(e){this.mask|=1<<e}enableAll(){this.mask=-1}toggle(e){this.mask^=1<<e}disable(e){this.mask&=~(1<<e)}disableAll(){this.mask=0}test(e){return(this.mask&e.mask)!==0}isEnabled(e){return!!(this.mask&1<<e)}},Em=0,Gu=new A,qn=new ni,Ui=new De,Hs=new A,Ir=new A,Am=new A,Cm=new ni,Vu=new A(1,0,0),Hu=new A(0,1,0),Wu=new A(0,0,1),Xu={type:"added"},Rm={type:"removed"},Yn={type:"childadded",child:null},yl={type:"childremoved",child:null},ii=class r extends Ei{constructor(){super(),this.isObject3D=!0,Object.defineProperty(this,"id",{value:Em++}),this.uuid=gr(),this.name="",this.type="Object3D",this.parent=null,this.children=[],this.up=r.DEFAULT_UP.clone();let e=new A,t=new tn,i=new ni,n=new A(1,1,1);t._onChange(function(){i.setFromEuler(t,!1)}),i._onChange(function(){t.setFromQuaternion(i,void 0,!1)}),Object.defineProperties(this,{position:{configurable:!0,enumerable:!0,value:e},rotation:{configurable:!0,enumerable:!0,value:t},quaternion:{configurable:!0,enumerable:!0,value:i},scale:{configurable:!0,enumerable:!0,value:n},modelViewMatrix:{value:new De},normalMatrix:{value:new Ue}}),this.matrix=new De,this.matrixWorld=new De,this.matrixAutoUpdate=r.DEFAULT_MATRIX_AUTO_UPDATE,this.matrixWorldAutoUpdate=r.DEFAULT_MATRIX_WORLD_AUTO_UPDATE,this.matrixWorldNeedsUpdate=!1,this.layers=new Hr,this.visible=!0,this.castShadow=!1,this.receiveShadow=!1,this.frustumCulled=!0,this.renderOrder=0,this.animations=[],this.customDepthMaterial=void 0,this.customDistanceMaterial=void 0,this.static=!1,this.userData={},this.pivot=null}onBeforeShadow(){}onAfterShadow(){}onBeforeRender(){}onAfterRender(){}applyMatrix4(e){this.matrixAutoUpdate&&this.updateMatrix(),this.matrix.premultiply(e),this.matrix.decompose(this.position,this.quaternion,this.scale)}applyQuaternion(e){return this.quaternion.premultiply(e),this}setRotationFromAxisAngle(e,t){this.quaternion.setFromAxisAngle(e,t)}setRotationFromEuler(e){this.quaternion.setFromEuler(e,!0)}setRotationFromMatrix(e){this.quaternion.setFromRotationMatrix(e)}setRotationFromQuaternion(e){this.quaternion.copy(e)}rotateOnAxis(e,t){return qn.setFromAxisAngle(e,t),this.quaternion.multiply(qn),this}rotateOnWorldAxis(e,t){return qn.setFromAxisAngle(e,t),this.quaternion.premultiply(qn),this}rotateX(e){return this.rotateOnAxis(Vu,e)}rotateY(e){return this.rotateOnAxis(Hu,e)}rotateZ(e){return this.rotateOnAxis(Wu,e)}translateOnAxis(e,t){return Gu.copy(e).applyQuaternion(this.quaternion),this.position.add(Gu.multiplyScalar(t)),this}translateX(e){return this.translateOnAxis(Vu,e)}translateY(e){return this.translateOnAxis(Hu,e)}translateZ(e){return this.translateOnAxis(Wu,e)}localToWorld(e){return this.updateWorldMatrix(!0,!1),e.applyMatrix4(this.matrixWorld)}worldToLocal(e){return this.updateWorldMatrix(!0,!1),e.applyMatrix4(Ui.copy(this.matrixWorld).invert())}lookAt(e,t,i){e.isVector3?Hs.copy(e):Hs.set(e,t,i);let n=this.parent;this.updateWorldMatrix(!0,!1),Ir.setFromMatrixPosition(this.matrixWorld),this.isCamera||this.isLight?Ui.lookAt(Ir,Hs,this.up):Ui.lookAt(Hs,Ir,this.up),this.quaternion.setFromRotationMatrix(Ui),n&&(Ui.extractRotation(n.matrixWorld),qn.setFromRotationMatrix(Ui),this.quaternion.premultiply(qn.invert()))}add(e){if(arguments.length>1){for(let t=0;t<arguments.length;t++)this.add(arguments[t]);return this}return e===this?(Te("Object3D.add: object can't be added as a child of itself.",e),this):(e&&e.isObject3D?(e.removeFromParent(),e.parent=this,this.children.push(e),e.dispatchEvent(Xu),Yn.child=e,this.dispatchEvent(Yn),Yn.child=null):Te("Object3D.add: object not an instance of THREE.Object3D.",e),this)}remove(e){if(arguments.length>1){for(let i=0;i<arguments.length;i++)this.remove(arguments[i]);return this}let t=this.children.indexOf(e);return t!==-1&&(e.parent=null,this.children.splice(t,1),e.dispatchEvent(Rm),yl.child=e,this.dispatchEvent(yl),yl.child=null),this}removeFromParent(){let e=this.parent;return e!==null&&e.remove(this),this}clear(){return this.remove(...this.children)}attach(e){return this.updateWorldMatrix(!0,!1),Ui.copy(this.matrixWorld).invert(),e.parent!==null&&(e.parent.updateWorldMatrix(!0,!1),Ui.multiply(e.parent.matrixWorld)),e.applyMatrix4(Ui),e.removeFromParent(),e.parent=this,this.children.push(e),e.updateWorldMatrix(!1,!0),e.dispatchEvent(Xu),Yn.child=e,this.dispatchEvent(Yn),Yn.child=null,this}getObjectById(e){return this.getObjectByProperty("id",e)}getObjectByName(e){return this.getObjectByProperty("name",e)}getObjectByProperty(e,t){if(this[e]===t)return this;for(let i=0,n=this.children.length;i<n;i++){let s=this.children[i].getObjectByProperty(e,t);if(s!==void 0)return s}}getObjectsByProperty(e,t,i=[]){this[e]===t&&i.push(this);let n=this.children;for(let s=0,a=n.length;s<a;s++)n[s].getObjectsByProperty(e,t,i);return i}getWorldPosition(e){return this.updateWorldMatrix(!0,!1),e.setFromMatrixPosition(this.matrixWorld)}getWorldQuaternion(e){return this.updateWorldMatrix(!0,!1),this.matrixWorld.decompose(Ir,e,Am),e}getWorldScale(e){return this.updateWorldMatrix(!0,!1),this.matrixWorld.decompose(Ir,Cm,e),e}getWorldDirection(e){this.updateWorldMatrix(!0,!1);let t=this.matrixWorld.elements;return e.set(t[8],t[9],t[10]).normalize()}raycast(){}traverse(e){e(this);let t=this.children;for(let i=0,n=t.length;i<n;i++)t[i].traverse(e)}traverseVisible(e){if(this.visible===!1)return;e(this);let t=this.children;for(let i=0,n=t.length;i<n;i++)t[i].traverseVisible(e)}traverseAncestors(e){let t=this.parent;t!==null&&(e(t),t.traverseAncestors(e))}updateMatrix(){this.matrix.compose(this.position,this.quaternion,this.scale);let e=this.pivot;if(e!==null){let t=e.x,i=e.y,n=e.z,s=this.matrix.elements;s[12]+=t-s[0]*t-s[4]*i-s[8]*n,s[13]+=i-s[1]*t-s[5]*i-s[9]*n,s[14]+=n-s[2]*t-s[6]*i-s[10]*n}this.matrixWorldNeedsUpdate=!0}updateMatrixWorld(e){this.matrixAutoUpdate&&this.updateMatrix(),(this.matrixWorldNeedsUpdate||e)&&(this.matrixWorldAutoUpdate===!0&&(this.parent===null?this.matrixWorld.copy(this.matrix):this.matrixWorld.multiplyMatrices(this.parent.matrixWorld,this.matrix)),this.matrixWorldNeedsUpdate=!1,e=!0);let t=this.children;for(let i=0,n=t.length;i<n;i++)t[i].updateMatrixWorld(e)}updateWorldMatrix(e,t){let i=this.parent;if(e===!0&&i!==null&&i.updateWorldMatrix(!0,!1),this.matrixAutoUpdate&&this.updateMatrix(),this.matrixWorldAutoUpdate===!0&&(this.parent===null?this.matrixWorld.copy(this.matrix):this.matrixWorld.multiplyMatrices(this.parent.matrixWorld,this.matrix)),t===!0){let n=this.children;for(let s=0,a=n.length;s<a;s++)n[s].updateWorldMatrix(!1,!0)}}toJSON(e){let t=e===void 0||typeof e=="string",i={};t&&(e={geometries:{},materials:{},textures:{},images:{},shapes:{},skeletons:{},animations:{},nodes:{}},i.metadata={version:4.7,type:"Object",generator:"Object3D.toJSON"});let n={};function s(o,l){return o[l.uuid]===void 0&&(o[l.uuid]=l.toJSON(e)),l.uuid}if(n.uuid=this.uuid,n.type=this.type,this.name!==""&&(n.name=this.name),this.castShadow===!0&&(n.castShadow=!0),this.receiveShadow===!0&&(n.receiveShadow=!0),this.visible===!1&&(n.visible=!1),this.frustumCulled===!1&&(n.frustumCulled=!1),this.renderOrder!==0&&(n.renderOrder=this.renderOrder),this.static!==!1&&(n.static=this.static),Object.keys(this.userData).length>0&&(n.userData=this.userData),n.layers=this.layers.mask,n.matrix=this.matrix.toArray(),n.up=this.up.toArray(),this.pivot!==null&&(n.pivot=this.pivot.toArray()),this.matrixAutoUpdate===!1&&(n.matrixAutoUpdate=!1),this.morphTargetDictionary!==void 0&&(n.morphTargetDictionary=Object.assign({},this.morphTargetDictionary)),this.morphTargetInfluences!==void 0&&(n.morphTargetInfluences=this.morphTargetInfluences.slice()),this.isInstancedMesh&&(n.type="InstancedMesh",n.count=this.count,n.instanceMatrix=this.instanceMatrix.toJSON(),this.instanceColor!==null&&(n.instanceColor=this.instanceColor.toJSON())),this.isBatchedMesh&&(n.type="BatchedMesh",n.perObjectFrustumCulled=this.perObjectFrustumCulled,n.sortObjects=this.sortObjects,n.drawRanges=this._drawRanges,n.reservedRanges=this._reservedRanges,n.geometryInfo=this._geometryInfo.map(o=>({...o,boundingBox:o.boundingBox?o.boundingBox.toJSON():void 0,boundingSphere:o.boundingSphere?o.boundingSphere.toJSON():void 0})),n.instanceInfo=this._instanceInfo.map(o=>({...o})),n.availableInstanceIds=this._availableInstanceIds.slice(),n.availableGeometryIds=this._availableGeometryIds.slice(),n.nextIndexStart=this._nextIndexStart,n.nextVertexStart=this._nextVertexStart,n.geometryCount=this._geometryCount,n.maxInstanceCount=this._maxInstanceCount,n.maxVertexCount=this._maxVertexCount,n.maxIndexCount=this._maxIndexCount,n.geometryInitialized=this._geometryInitialized,n.matricesTexture=this._matricesTexture.toJSON(e),n.indirectTexture=this._indirectTexture.toJSON(e),this._colorsTexture!==null&&(n.colorsTexture=this._colorsTexture.toJSON(e)),this.boundingSphere!==null&&(n.boundingSphere=this.boundingSphere.toJSON()),this.boundingBox!==null&&(n.boundingBox=this.boundingBox.toJSON())),this.isScene)this.background&&(this.background.isColor?n.background=this.background.toJSON():this.background.isTexture&&(n.background=this.background.toJSON(e).uuid)),this.environment&&this.environment.isTexture&&this.environment.isRenderTargetTexture!==!0&&(n.environment=this.environment.toJSON(e).uuid);else if(this.isMesh||this.isLine||this.isPoints){n.geometry=s(e.geometries,this.geometry);let o=this.geometry.parameters;if(o!==void 0&&o.shapes!==void 0){let l=o.shapes;if(Array.isArray(l))for(let c=0,h=l.length;c<h;c++){let u=l[c];s(e.shapes,u)}else s(e.shapes,l)}}if(this.isSkinnedMesh&&(n.bindMode=this.bindMode,n.bindMatrix=this.bindMatrix.toArray(),this.skeleton!==void 0&&(s(e.skeletons,this.skeleton),n.skeleton=this.skeleton.uuid)),this.material!==void 0)if(Array.isArray(this.material)){let o=[];for(let l=0,c=this.material.length;l<c;l++)o.push(s(e.materials,this.material[l]));n.material=o}else n.material=s(e.materials,this.material);if(this.children.length>0){n.children=[];for(let o=0;o<this.children.length;o++)n.children.push(this.children[o].toJSON(e).object)}if(this.animations.length>0){n.animations=[];for(let o=0;o<this.animations.length;o++){let l=this.animations[o];n.animations.push(s(e.animations,l))}}if(t){let o=a(e.geometries),l=a(e.materials),c=a(e.textures),h=a(e.images),u=a(e.shapes),f=a(e.skeletons),p=a(e.animations),g=a(e.nodes);o.length>0&&(i.geometries=o),l.length>0&&(i.materials=l),c.length>0&&(i.textures=c),h.length>0&&(i.images=h),u.length>0&&(i.shapes=u),f.length>0&&(i.skeletons=f),p.length>0&&(i.animations=p),g.length>0&&(i.nodes=g)}return i.object=n,i;function a(o){let l=[];for(let c in o){let h=o[c];delete h.metadata,l.push(h)}return l}}clone(e){return new this.constructor().copy(this,e)}copy(e,t=!0){if(this.name=e.name,this.up.copy(e.up),this.position.copy(e.position),this.rotation.order=e.rotation.order,this.quaternion.copy(e.quaternion),this.scale.copy(e.scale),this.pivot=e.pivot!==null?e.pivot.clone():null,this.matrix.copy(e.matrix),this.matrixWorld.copy(e.matrixWorld),this.matrixAutoUpdate=e.matrixAutoUpdate,this.matrixWorldAutoUpdate=e.matrixWorldAutoUpdate,this.matrixWorldNeedsUpdate=e.matrixWorldNeedsUpdate,this.layers.mask=e.layers.mask,this.visible=e.visible,this.castShadow=e.castShadow,this.receiveShadow=e.receiveShadow,this.frustumCulled=e.frustumCulled,this.renderOrder=e.renderOrder,this.static=e.static,this.animations=e.animations.slice(),this.userData=JSON.parse(JSON.stringify(e.userData)),t===!0)for(let i=0;i<e.children.length;i++){let n=e.children[i];this.add(n.clone())}return this}};ii.DEFAULT_UP=new A(0,1,0),ii.DEFAULT_MATRIX_AUTO_UPDATE=!0,ii.DEFAULT_MATRIX_WORLD_AUTO_UPDATE=!0;var yn=class extends ii{constructor(){super(),this.isGroup=!0,this.type="Group"}},Im={type:"move"},sr=class{constructor(){this._targetRay=null,this._grip=null,this._hand=null}getHandSpace(){return this._hand===null&&(this._hand=new yn,this._hand.matrixAutoUpdate=!1,this._hand.visible=!1,this._hand.joints={},this._hand.inputState={pinching:!1}),this._hand}getTargetRaySpace(){return this._targetRay===null&&(this._targetRay=new yn,this._targetRay.matrixAutoUpdate=!1,this._targetRay.visible=!1,this._targetRay.hasLinearVelocity=!1,this._targetRay.linearVelocity=new A,this._targetRay.hasAngularVelocity=!1,this._targetRay.angularVelocity=new A),this._targetRay}getGripSpace(){return this._grip===null&&(this._grip=new yn,this._grip.matrixAutoUpdate=!1,this._grip.visible=!1,this._grip.hasLinearVelocity=!1,this._grip.linearVelocity=new A,this._grip.hasAngularVelocity=!1,this._grip.angularVelocity=new A,this._grip.eventsEnabled=!1),this._grip}dispatchEvent(e){return this._targetRay!==null&&this._targetRay.dispatchEvent(e),this._grip!==null&&this._grip.dispatchEvent(e),this._hand!==null&&this._hand.dispatchEvent(e),this}connect(e){if(e&&e.hand){let t=this._hand;if(t)for(let i of e.hand.values())this._getHandJoint(t,i)}return this.dispatchEvent({type:"connected",data:e}),this}disconnect(e){return this.dispatchEvent({type:"disconnected",data:e}),this._targetRay!==null&&(this._targetRay.visible=!1),this._grip!==null&&(this._grip.visible=!1),this._hand!==null&&(this._hand.visible=!1),this}update(e,t,i){let n=null,s=null,a=null,o=this._targetRay,l=this._grip,c=this._hand;if(e&&t.session.visibilityState!=="visible-blurred"){if(c&&e.hand){a=!0;for(let d of e.hand.values()){let _=t.getJointPose(d,i),m=this._getHandJoint(c,d);_!==null&&(m.matrix.fromArray(_.transform.matrix),m.matrix.decompose(m.position,m.rotation,m.scale),m.matrixWorldNeedsUpdate=!0,m.jointRadius=_.radius),m.visible=_!==null}let h=c.joints["index-finger-tip"],u=c.joints["thumb-tip"],f=h.position.distanceTo(u.position),p=.02,g=.005;c.inputState.pinching&&f>p+g?(c.inputState.pinching=!1,this.dispatchEvent({type:"pinchend",handedness:e.handedness,target:this})):!c.inputState.pinching&&f<=p-g&&(c.inputState.pinching=!0,this.dispatchEvent({type:"pinchstart",handedness:e.handedness,target:this}))}else l!==null&&e.gripSpace&&(s=t.getPose(e.gripSpace,i),s!==null&&(l.matrix.fromArray(s.transform.matrix),l.matrix.decompose(l.position,l.rotation,l.scale),l.matrixWorldNeedsUpdate=!0,s.linearVelocity?(l.hasLinearVelocity=!0,l.linearVelocity.copy(s.linearVelocity)):l.hasLinearVelocity=!1,s.angularVelocity?(l.hasAngularVelocity=!0,l.angularVelocity.copy(s.angularVelocity)):l.hasAngularVelocity=!1,l.eventsEnabled&&l.dispatchEvent({type:"gripUpdated",data:e,target:this})));o!==null&&(n=t.getPose(e.targetRaySpace,i),n===null&&s!==null&&(n=s),n!==null&&(o.matrix.fromArray(n.transform.matrix),o.matrix.decompose(o.position,o.rotation,o.scale),o.matrixWorldNeedsUpdate=!0,n.linearVelocity?(o.hasLinearVelocity=!0,o.linearVelocity.copy(n.linearVelocity)):o.hasLinearVelocity=!1,n.angularVelocity?(o.hasAngularVelocity=!0,o.angularVelocity.copy(n.angularVelocity)):o.hasAngularVelocity=!1,this.dispatchEvent(Im)))}return o!==null&&(o.visible=n!==null),l!==null&&(l.visible=s!==null),c!==null&&(c.visible=a!==null),this}_getHandJoint(e,t){if(e.joints[t.jointName]===void 0){let i=new yn;i.matrixAutoUpdate=!1,i.visible=!1,e.joints[t.jointName]=i,e.add(i)}return e.joints[t.jointName]}},qd={aliceblue:15792383,antiquewhite:16444375,aqua:65535,aquamarine:8388564,azure:15794175,beige:16119260,bisque:16770244,black:0,blanchedalmond:16772045,blue:255,blueviolet:9055202,brown:10824234,burlywood:14596231,cadetblue:6266528,chartreuse:8388352,chocolate:13789470,coral:16744272,cornflowerblue:6591981,cornsilk:16775388,crimson:14423100,cyan:65535,darkblue:139,darkcyan:35723,darkgoldenrod:12092939,darkgray:11119017,darkgreen:25600,darkgrey:11119017,darkkhaki:12433259,darkmagenta:9109643,darkolivegreen:5597999,darkorange:16747520,darkorchid:10040012,darkred:9109504,darksalmon:15308410,darkseagreen:9419919,darkslateblue:4734347,darkslategray:3100495,darkslategrey:3100495,darkturquoise:52945,darkviolet:9699539,deeppink:16716947,deepskyblue:49151,dimgray:6908265,dimgrey:6908265,dodgerblue:2003199,firebrick:11674146,floralwhite:16775920,forestgreen:2263842,fuchsia:16711935,gainsboro:14474460,ghostwhite:16316671,gold:16766720,goldenrod:14329120,gray:8421504,green:32768,greenyellow:11403055,grey:8421504,honeydew:15794160,hotpink:16738740,indianred:13458524,indigo:4915330,ivory:16777200,khaki:15787660,lavender:15132410,lavenderblush:16773365,lawngreen:8190976,lemonchiffon:16775885,lightblue:11393254,lightcoral:15761536,lightcyan:14745599,lightgoldenrodyellow:16448210,lightgray:13882323,lightgreen:9498256,lightgrey:13882323,lightpink:16758465,lightsalmon:16752762,lightseagreen:2142890,lightskyblue:8900346,lightslategray:7833753,lightslategrey:7833753,lightsteelblue:11584734,lightyellow:16777184,lime:65280,limegreen:3329330,linen:16445670,magenta:16711935,maroon:8388608,mediumaquamarine:6737322,mediumblue:205,mediumorchid:12211667,mediumpurple:9662683,mediumseagreen:3978097,mediumslateblue:8087790,mediumspringgreen:64154,mediumturquoise:4772300,mediumvioletred:13047173,midnightblue:1644912,mintcream:16121850,mistyrose:16770273,moccasin:16770229,navajowhite:16768685,navy:128,oldlace:16643558,olive:8421376,olivedrab:7048739,orange:16753920,orangered:16729344,orchid:14315734,palegoldenrod:15657130,palegreen:10025880,paleturquoise:11529966,palevioletred:14381203,papayawhip:16773077,peachpuff:16767673,peru:13468991,pink:16761035,plum:14524637,powderblue:11591910,purple:8388736,rebeccapurple:6697881,red:16711680,rosybrown:12357519,royalblue:4286945,saddlebrown:9127187,salmon:16416882,sandybrown:16032864,seagreen:3050327,seashell:16774638,sienna:10506797,silver:12632256,skyblue:8900331,slateblue:6970061,slategray:7372944,slategrey:7372944,snow:16775930,springgreen:65407,steelblue:4620980,tan:13808780,teal:32896,thistle:14204888,tomato:16737095,turquoise:4251856,violet:15631086,wheat:16113331,white:16777215,whitesmoke:16119285,yellow:16776960,yellowgreen:10145074},Yi={h:0,s:0,l:0},Ws={h:0,s:0,l:0};function Ml(r,e,t){return t<0&&(t+=1),t>1&&(t-=1),t<1/6?r+6*(e-r)*t:t<.5?e:t<2/3?r+6*(e-r)*(2/3-t):r}var je=class{constructor(e,t,i){return this.isColor=!0,this.r=1,this.g=1,this.b=1,this.set(e,t,i)}set(e,t,i){if(t===void 0&&i===void 0){let n=e;n&&n.isColor?this.copy(n):typeof n=="number"?this.setHex(n):typeof n=="string"&&this.setStyle(n)}else this.setRGB(e,t,i);return this}setScalar(e){return this.r=e,this.g=e,this.b=e,this}setHex(e,t=Yt){return e=Math.floor(e),this.r=(e>>16&255)/255,this.g=(e>>8&255)/255,this.b=(255&e)/255,Ve.colorSpaceToWorking(this,t),this}setRGB(e,t,i,n=Ve.workingColorSpace){return this.r=e,this.g=t,this.b=i,Ve.colorSpaceToWorking(this,n),this}setHSL(e,t,i,n=Ve.workingColorSpace){if(e=ym(e,1),t=Be(t,0,1),i=Be(i,0,1),t===0)this.r=this.g=this.b=i;else{let s=i<=.5?i*(1+t):i+t-i*t,a=2*i-s;this.r=Ml(a,s,e+1/3),this.g=Ml(a,s,e),this.b=Ml(a,s,e-1/3)}return Ve.colorSpaceToWorking(this,n),this}setStyle(e,t=Yt){function i(s){s!==void 0&&parseFloat(s)<1&&we("Color: Alpha component of "+e+" will be ignored.")}let n;if(n=/^(\w+)\(([^\)]*)\)/.exec(e)){let s,a=n[1],o=n[2];switch(a){case"rgb":case"rgba":if(s=/^\s*(\d+)\s*,\s*(\d+)\s*,\s*(\d+)\s*(?:,\s*(\d*\.?\d+)\s*)?$/.exec(o))return i(s[4]),this.setRGB(Math.min(255,parseInt(s[1],10))/255,Math.min(255,parseInt(s[2],10))/255,Math.min(255,parseInt(s[3],10))/255,t);if(s=/^\s*(\d+)\%\s*,\s*(\d+)\%\s*,\s*(\d+)\%\s*(?:,\s*(\d*\.?\d+)\s*)?$/.exec(o))return i(s[4]),this.setRGB(Math.min(100,parseInt(s[1],10))/100,Math.min(100,parseInt(s[2],10))/100,Math.min(100,parseInt(s[3],10))/100,t);break;case"hsl":case"hsla":if(s=/^\s*(\d*\.?\d+)\s*,\s*(\d*\.?\d+)\%\s*,\s*(\d*\.?\d+)\%\s*(?:,\s*(\d*\.?\d+)\s*)?$/.exec(o))return i(s[4]),this.setHSL(parseFloat(s[1])/360,parseFloat(s[2])/100,parseFloat(s[3])/100,t);break;default:we("Color: Unknown color model "+e)}}else if(n=/^\#([A-Fa-f\d]+)$/.exec(e)){let s=n[1],a=s.length;if(a===3)return this.setRGB(parseInt(s.charAt(0),16)/15,parseInt(s.charAt(1),16)/15,parseInt(s.charAt(2),16)/15,t);if(a===6)return this.setHex(parseInt(s,16),t);we("Color: Invalid hex color "+e)}else if(e&&e.length>0)return this.setColorName(e,t);return this}setColorName(e,t=Yt){let i=qd[e.toLowerCase()];return i!==void 0?this.setHex(i,t):we("Color: Unknown color "+e),this}clone(){return new this.constructor(this.r,this.g,this.b)}copy(e){return this.r=e.r,this.g=e.g,this.b=e.b,this}copySRGBToLinear(e){return this.r=ki(e.r),this.g=ki(e.g),this.b=ki(e.b),this}copyLinearToSRGB(e){return this.r=ir(e.r),this.g=ir(e.g),this.b=ir(e.b),this}convertSRGBToLinear(){return this.copySRGBToLinear(this),this}convertLinearToSRGB(){return this.copyLinearToSRGB(this),this}getHex(e=Yt){return Ve.workingToColorSpace(Ut.copy(this),e),65536*Math.round(Be(255*Ut.r,0,255))+256*Math.round(Be(255*Ut.g,0,255))+Math.round(Be(255*Ut.b,0,255))}getHexString(e=Yt){return("000000"+this.getHex(e).toString(16)).slice(-6)}getHSL(e,t=Ve.workingColorSpace){Ve.workingToColorSpace(Ut.copy(this),t);let i=Ut.r,n=Ut.g,s=Ut.b,a=Math.max(i,n,s),o=Math.min(i,n,s),l,c,h=(o+a)/2;if(o===a)l=0,c=0;else{let u=a-o;switch(c=h<=.5?u/(a+o):u/(2-a-o),a){case i:l=(n-s)/u+(n<s?6:0);break;case n:l=(s-i)/u+2;break;case s:l=(i-n)/u+4}l/=6}return e.h=l,e.s=c,e.l=h,e}getRGB(e,t=Ve.workingColorSpace){return Ve.workingToColorSpace(Ut.copy(this),t),e.r=Ut.r,e.g=Ut.g,e.b=Ut.b,e}getStyle(e=Yt){Ve.workingToColorSpace(Ut.copy(this),e);let t=Ut.r,i=Ut.g,n=Ut.b;return e!==Yt?`color(${e} ${t.toFixed(3)} ${i.toFixed(3)} ${n.toFixed(3)})`:`rgb(${Math.round(255*t)},${Math.round(255*i)},${Math.round(255*n)})`}offsetHSL(e,t,i){return this.getHSL(Yi),this.setHSL(Yi.h+e,Yi.s+t,Yi.l+i)}add(e){return this.r+=e.r,this.g+=e.g,this.b+=e.b,this}addColors(e,t){return this.r=e.r+t.r,this.g=e.g+t.g,this.b=e.b+t.b,this}addScalar(e){return this.r+=e,this.g+=e,this.b+=e,this}sub(e){return this.r=Math.max(0,this.r-e.r),this.g=Math.max(0,this.g-e.g),this.b=Math.max(0,this.b-e.b),this}multiply(e){return this.r*=e.r,this.g*=e.g,this.b*=e.b,this}multiplyScalar(e){return this.r*=e,this.g*=e,this.b*=e,this}lerp(e,t){return this.r+=(e.r-this.r)*t,this.g+=(e.g-this.g)*t,this.b+=(e.b-this.b)*t,this}lerpColors(e,t,i){return this.r=e.r+(t.r-e.r)*i,this.g=e.g+(t.g-e.g)*i,this.b=e.b+(t.b-e.b)*i,this}lerpHSL(e,t){this.getHSL(Yi),e.getHSL(Ws);let i=ml(Yi.h,Ws.h,t),n=ml(Yi.s,Ws.s,t),s=ml(Yi.l,Ws.l,t);return this.setHSL(i,n,s),this}setFromVector3(e){return this.r=e.x,this.g=e.y,this.b=e.z,this}applyMatrix3(e){let t=this.r,i=this.g,n=this.b,s=e.elements;return this.r=s[0]*t+s[3]*i+s[6]*n,this.g=s[1]*t+s[4]*i+s[7]*n,this.b=s[2]*t+s[5]*i+s[8]*n,this}equals(e){return e.r===this.r&&e.g===this.g&&e.b===this.b}fromArray(e,t=0){return this.r=e[t],this.g=e[t+1],this.b=e[t+2],this}toArray(e=[],t=0){return e[t]=this.r,e[t+1]=this.g,e[t+2]=this.b,e}fromBufferAttribute(e,t){return this.r=e.getX(t),this.g=e.getY(t),this.b=e.getZ(t),this}toJSON(){return this.getHex()}*[Symbol.iterator](){yield this.r,yield this.g,yield this.b}},Ut=new je;je.NAMES=qd;var ar=class extends ii{constructor(){super(),this.isScene=!0,this.type="Scene",this.background=null,this.environment=null,this.fog=null,this.backgroundBlurriness=0,this.backgroundIntensity=1,this.backgroundRotation=new tn,this.environmentIntensity=1,this.environmentRotation=new tn,this.overrideMaterial=null,typeof __THREE_DEVTOOLS__<"u"&&__THREE_DEVTOOLS__.dispatchEvent(new CustomEvent("observe",{detail:this}))}copy(e,t){return super.copy(e,t),e.background!==null&&(this.background=e.background.clone()),e.environment!==null&&(this.environment=e.environment.clone()),e.fog!==null&&(this.fog=e.fog.clone()),this.backgroundBlurriness=e.backgroundBlurriness,this.backgroundIntensity=e.backgroundIntensity,this.backgroundRotation.copy(e.backgroundRotation),this.environmentIntensity=e.environmentIntensity,this.environmentRotation.copy(e.environmentRotation),e.overrideMaterial!==null&&(this.overrideMaterial=e.overrideMaterial.clone()),this.matrixAutoUpdate=e.matrixAutoUpdate,this}toJSON(e){let t=super.toJSON(e);return this.fog!==null&&(t.object.fog=this.fog.toJSON()),this.backgroundBlurriness>0&&(t.object.backgroundBlurriness=this.backgroundBlurriness),this.backgroundIntensity!==1&&(t.object.backgroundIntensity=this.backgroundIntensity),t.object.backgroundRotation=this.backgroundRotation.toArray(),this.environmentIntensity!==1&&(t.object.environmentIntensity=this.environmentIntensity),t.object.environmentRotation=this.environmentRotation.toArray(),t}},hi=new A,Di=new A,Sl=new A,Ni=new A,Zn=new A,Kn=new A,ju=new A,bl=new A,wl=new A,Tl=new A,El=new $e,Al=new $e,Cl=new $e,Bi=class r{constructor(e=new A,t=new A,i=new A){this.a=e,this.b=t,this.c=i}static getNormal(e,t,i,n){n.subVectors(i,t),hi.subVectors(e,t),n.cross(hi);let s=n.lengthSq();return s>0?n.multiplyScalar(1/Math.sqrt(s)):n.set(0,0,0)}static getBarycoord(e,t,i,n,s){hi.subVectors(n,t),Di.subVectors(i,t),Sl.subVectors(e,t);let a=hi.dot(hi),o=hi.dot(Di),l=hi.dot(Sl),c=Di.dot(Di),h=Di.dot(Sl),u=a*c-o*o;if(u===0)return s.set(0,0,0),null;let f=1/u,p=(c*l-o*h)*f,g=(a*h-o*l)*f;return s.set(1-p-g,g,p)}static containsPoint(e,t,i,n){return this.getBarycoord(e,t,i,n,Ni)!==null&&Ni.x>=0&&Ni.y>=0&&Ni.x+Ni.y<=1}static getInterpolation(e,t,i,n,s,a,o,l){return this.getBarycoord(e,t,i,n,Ni)===null?(l.x=0,l.y=0,"z"in l&&(l.z=0),"w"in l&&(l.w=0),null):(l.setScalar(0),l.addScaledVector(s,Ni.x),l.addScaledVector(a,Ni.y),l.addScaledVector(o,Ni.z),l)}static getInterpolatedAttribute(e,t,i,n,s,a){return El.setScalar(0),Al.setScalar(0),Cl.setScalar(0),El.fromBufferAttribute(e,t),Al.fromBufferAttribute(e,i),Cl.fromBufferAttribute(e,n),a.setScalar(0),a.addScaledVector(El,s.x),a.addScaledVector(Al,s.y),a.addScaledVector(Cl,s.z),a}static isFrontFacing(e,t,i,n){return hi.subVectors(i,t),Di.subVectors(e,t),hi.cross(Di).dot(n)<0}set(e,t,i){return this.a.copy(e),this.b.copy(t),this.c.copy(i),this}setFromPointsAndIndices(e,t,i,n){return this.a.copy(e[t]),this.b.copy(e[i]),this.c.copy(e[n]),this}setFromAttributeAndIndices(e,t,i,n){return this.a.fromBufferAttribute(e,t),this.b.fromBufferAttribute(e,i),this.c.fromBufferAttribute(e,n),this}clone(){return new this.constructor().copy(this)}copy(e){return this.a.copy(e.a),this.b.copy(e.b),this.c.copy(e.c),this}getArea(){return hi.subVectors(this.c,this.b),Di.subVectors(this.a,this.b),.5*hi.cross(Di).length()}getMidpoint(e){return e.addVectors(this.a,this.b).add(this.c).multiplyScalar(1/3)}getNormal(e){return r.getNormal(this.a,this.b,this.c,e)}getPlane(e){return e.setFromCoplanarPoints(this.a,this.b,this.c)}getBarycoord(e,t){return r.getBarycoord(e,this.a,this.b,this.c,t)}getInterpolation(e,t,i,n,s){return r.getInterpolation(e,this.a,this.b,this.c,t,i,n,s)}containsPoint(e){return r.containsPoint(e,this.a,this.b,this.c)}isFrontFacing(e){return r.isFrontFacing(this.a,this.b,this.c,e)}intersectsBox(e){return e.intersectsTriangle(this)}closestPointToPoint(e,t){let i=this.a,n=this.b,s=this.c,a,o;Zn.subVectors(n,i),Kn.subVectors(s,i),bl.subVectors(e,i);let l=Zn.dot(bl),c=Kn.dot(bl);if(l<=0&&c<=0)return t.copy(i);wl.subVectors(e,n);let h=Zn.dot(wl),u=Kn.dot(wl);if(h>=0&&u<=h)return t.copy(n);let f=l*u-h*c;if(f<=0&&l>=0&&h<=0)return a=l/(l-h),t.copy(i).addScaledVector(Zn,a);Tl.subVectors(e,s);let p=Zn.dot(Tl),g=Kn.dot(Tl);if(g>=0&&p<=g)return t.copy(s);let d=p*c-l*g;if(d<=0&&c>=0&&g<=0)return o=c/(c-g),t.copy(i).addScaledVector(Kn,o);let _=h*g-p*u;if(_<=0&&u-h>=0&&p-g>=0)return ju.subVectors(s,n),o=(u-h)/(u-h+(p-g)),t.copy(n).addScaledVector(ju,o);let m=1/(_+d+f);return a=d*m,o=f*m,t.copy(i).addScaledVector(Zn,a).addScaledVector(Kn,o)}equals(e){return e.a.equals(this.a)&&e.b.equals(this.b)&&e.c.equals(this.c)}},pi=class{constructor(e=new A(1/0,1/0,1/0),t=new A(-1/0,-1/0,-1/0)){this.isBox3=!0,this.min=e,this.max=t}set(e,t){return this.min.copy(e),this.max.copy(t),this}setFromArray(e){this.makeEmpty();for(let t=0,i=e.length;t<i;t+=3)this.expandByPoint(ui.fromArray(e,t));return this}setFromBufferAttribute(e){this.makeEmpty();for(let t=0,i=e.count;t<i;t++)this.expandByPoint(ui.fromBufferAttribute(e,t));return this}setFromPoints(e){this.makeEmpty();for(let t=0,i=e.length;t<i;t++)this.expandByPoint(e[t]);return this}setFromCenterAndSize(e,t){let i=ui.copy(t).multiplyScalar(.5);return this.min.copy(e).sub(i),this.max.copy(e).add(i),this}setFromObject(e,t=!1){return this.makeEmpty(),this.expandByObject(e,t)}clone(){return new this.constructor().copy(this)}copy(e){return this.min.copy(e.min),this.max.copy(e.max),this}makeEmpty(){return this.min.x=this.min.y=this.min.z=1/0,this.max.x=this.max.y=this.max.z=-1/0,this}isEmpty(){return this.max.x<this.min.x||this.max.y<this.min.y||this.max.z<this.min.z}getCenter(e){return this.isEmpty()?e.set(0,0,0):e.addVectors(this.min,this.max).multiplyScalar(.5)}getSize(e){return this.isEmpty()?e.set(0,0,0):e.subVectors(this.max,this.min)}expandByPoint(e){return this.min.min(e),this.max.max(e),this}expandByVector(e){return this.min.sub(e),this.max.add(e),this}expandByScalar(e){return this.min.addScalar(-e),this.max.addScalar(e),this}expandByObject(e,t=!1){e.updateWorldMatrix(!1,!1);let i=e.geometry;if(i!==void 0){let s=i.getAttribute("position");if(t===!0&&s!==void 0&&e.isInstancedMesh!==!0)for(let a=0,o=s.count;a<o;a++)e.isMesh===!0?e.getVertexPosition(a,ui):ui.fromBufferAttribute(s,a),ui.applyMatrix4(e.matrixWorld),this.expandByPoint(ui);else e.boundingBox!==void 0?(e.boundingBox===null&&e.computeBoundingBox(),Xs.copy(e.boundingBox)):(i.boundingBox===null&&i.computeBoundingBox(),Xs.copy(i.boundingBox)),Xs.applyMatrix4(e.matrixWorld),this.union(Xs)}let n=e.children;for(let s=0,a=n.length;s<a;s++)this.expandByObject(n[s],t);return this}containsPoint(e){return e.x>=this.min.x&&e.x<=this.max.x&&e.y>=this.min.y&&e.y<=this.max.y&&e.z>=this.min.z&&e.z<=this.max.z}containsBox(e){return this.min.x<=e.min.x&&e.max.x<=this.max.x&&this.min.y<=e.min.y&&e.max.y<=this.max.y&&this.min.z<=e.min.z&&e.max.z<=this.max.z}getParameter(e,t){return t.set((e.x-this.min.x)/(this.max.x-this.min.x),(e.y-this.min.y)/(this.max.y-this.min.y),(e.z-this.min.z)/(this.max.z-this.min.z))}intersectsBox(e){return e.max.x>=this.min.x&&e.min.x<=this.max.x&&e.max.y>=this.min.y&&e.min.y<=this.max.y&&e.max.z>=this.min.z&&e.min.z<=this.max.z}intersectsSphere(e){return this.clampPoint(e.center,ui),ui.distanceToSquared(e.center)<=e.radius*e.radius}intersectsPlane(e){let t,i;return e.normal.x>0?(t=e.normal.x*this.min.x,i=e.normal.x*this.max.x):(t=e.normal.x*this.max.x,i=e.normal.x*this.min.x),e.normal.y>0?(t+=e.normal.y*this.min.y,i+=e.normal.y*this.max.y):(t+=e.normal.y*this.max.y,i+=e.normal.y*this.min.y),e.normal.z>0?(t+=e.normal.z*this.min.z,i+=e.normal.z*this.max.z):(t+=e.normal.z*this.max.z,i+=e.normal.z*this.min.z),t<=-e.constant&&i>=-e.constant}intersectsTriangle(e){if(this.isEmpty())return!1;this.getCenter(Pr),js.subVectors(this.max,Pr),$n.subVectors(e.a,Pr),Jn.subVectors(e.b,Pr),Qn.subVectors(e.c,Pr),Zi.subVectors(Jn,$n),Ki.subVectors(Qn,Jn),mn.subVectors($n,Qn);let t=[0,-Zi.z,Zi.y,0,-Ki.z,Ki.y,0,-mn.z,mn.y,Zi.z,0,-Zi.x,Ki.z,0,-Ki.x,mn.z,0,-mn.x,-Zi.y,Zi.x,0,-Ki.y,Ki.x,0,-mn.y,mn.x,0];return!!Rl(t,$n,Jn,Qn,js)&&(t=[1,0,0,0,1,0,0,0,1],!!Rl(t,$n,Jn,Qn,js)&&(qs.crossVectors(Zi,Ki),t=[qs.x,qs.y,qs.z],Rl(t,$n,Jn,Qn,js)))}clampPoint(e,t){return t.copy(e).clamp(this.min,this.max)}distanceToPoint(e){return this.clampPoint(e,ui).distanceTo(e)}getBoundingSphere(e){return this.isEmpty()?e.makeEmpty():(this.getCenter(e.center),e.radius=.5*this.getSize(ui).length()),e}intersect(e){return this.min.max(e.min),this.max.min(e.max),this.isEmpty()&&this.makeEmpty(),this}union(e){return this.min.min(e.min),this.max.max(e.max),this}applyMatrix4(e){return this.isEmpty()||(Fi[0].set(this.min.x,this.min.y,this.min.z).applyMatrix4(e),Fi[1].set(this.min.x,this.min.y,this.max.z).applyMatrix4(e),Fi[2].set(this.min.x,this.max.y,this.min.z).applyMatrix4(e),Fi[3].set(this.min.x,this.max.y,this.max.z).applyMatrix4(e),Fi[4].set(this.max.x,this.min.y,this.min.z).applyMatrix4(e),Fi[5].set(this.max.x,this.min.y,this.max.z).applyMatrix4(e),Fi[6].set(this.max.x,this.max.y,this.min.z).applyMatrix4(e),Fi[7].set(this.max.x,this.max.y,this.max.z).applyMatrix4(e),this.setFromPoints(Fi)),this}translate(e){return this.min.add(e),this.max.add(e),this}equals(e){return e.min.equals(this.min)&&e.max.equals(this.max)}toJSON(){return{min:this.min.toArray(),max:this.max.toArray()}}fromJSON(e){return this.min.fromArray(e.min),this.max.fromArray(e.max),this}},Fi=[new A,new A,new A,new A,new A,new A,new A,new A],ui=new A,Xs=new pi,$n=new A,Jn=new A,Qn=new A,Zi=new A,Ki=new A,mn=new A,Pr=new A,js=new A,qs=new A,gn=new A;function Rl(r,e,t,i,n){for(let s=0,a=r.length-3;s<=a;s+=3){gn.fromArray(r,s);let o=n.x*Math.abs(gn.x)+n.y*Math.abs(gn.y)+n.z*Math.abs(gn.z),l=e.dot(gn),c=t.dot(gn),h=i.dot(gn);if(Math.max(-Math.max(l,c,h),Math.min(l,c,h))>o)return!1}return!0}var cx=Pm();function Pm(){let r=new ArrayBuffer(4),e=new Float32Array(r),t=new Uint32Array(r),i=new Uint32Array(512),n=new Uint32Array(512);for(let l=0;l<256;++l){let c=l-127;c<-27?(i[l]=0,i[256|l]=32768,n[l]=24,n[256|l]=24):c<-14?(i[l]=1024>>-c-14,i[256|l]=1024>>-c-14|32768,n[l]=-c-1,n[256|l]=-c-1):c<=15?(i[l]=c+15<<10,i[256|l]=c+15<<10|32768,n[l]=13,n[256|l]=13):c<128?(i[l]=31744,i[256|l]=64512,n[l]=24,n[256|l]=24):(i[l]=31744,i[256|l]=64512,n[l]=13,n[256|l]=13)}let s=new Uint32Array(2048),a=new Uint32Array(64),o=new Uint32Array(64);for(let l=1;l<1024;++l){let c=l<<13,h=0;for(;!(8388608&c);)c<<=1,h-=8388608;c&=-8388609,h+=947912704,s[l]=c|h}for(let l=1024;l<2048;++l)s[l]=939524096+(l-1024<<13);for(let l=1;l<31;++l)a[l]=l<<23;a[31]=1199570944,a[32]=2147483648;for(let l=33;l<63;++l)a[l]=2147483648+(l-32<<23);a[63]=3347054592;for(let l=1;l<64;++l)l!==32&&(o[l]=1024);return{floatView:e,uint32View:t,baseTable:i,shiftTable:n,mantissaTable:s,exponentTable:a,offsetTable:o}}var gt=new A,Ys=new ne,Lm=0,Et=class extends Ei{constructor(e,t,i=!1){if(super(),Array.isArray(e))throw new TypeError("THREE.BufferAttribute: array should be a Typed Array.");this.isBufferAttribute=!0,Object.defineProperty(this,"id",{value:Lm++}),this.name="",this.array=e,this.itemSize=t,this.count=e!==void 0?e.length/t:0,this.normalized=i,this.usage=jl,this.updateRanges=[],this.gpuType=gi,this.version=0}onUploadCallback(){}set needsUpdate(e){e===!0&&this.version++}setUsage(e){return this.usage=e,this}addUpdateRange(e,t){this.updateRanges.push({start:e,count:t})}clearUpdateRanges(){this.updateRanges.length=0}copy(e){return this.name=e.name,this.array=new e.array.constructor(e.array),this.itemSize=e.itemSize,this.count=e.count,this.normalized=e.normalized,this.usage=e.usage,this.gpuType=e.gpuType,this}copyAt(e,t,i){e*=this.itemSize,i*=t.itemSize;for(let n=0,s=this.itemSize;n<s;n++)this.array[e+n]=t.array[i+n];return this}copyArray(e){return this.array.set(e),this}applyMatrix3(e){if(this.itemSize===2)for(let t=0,i=this.count;t<i;t++)Ys.fromBufferAttribute(this,t),Ys.applyMatrix3(e),this.setXY(t,Ys.x,Ys.y);else if(this.itemSize===3)for(let t=0,i=this.count;t<i;t++)gt.fromBufferAttribute(this,t),gt.applyMatrix3(e),this.setXYZ(t,gt.x,gt.y,gt.z);return this}applyMatrix4(e){for(let t=0,i=this.count;t<i;t++)gt.fromBufferAttribute(this,t),gt.applyMatrix4(e),this.setXYZ(t,gt.x,gt.y,gt.z);return this}applyNormalMatrix(e){for(let t=0,i=this.count;t<i;t++)gt.fromBufferAttribute(this,t),gt.applyNormalMatrix(e),this.setXYZ(t,gt.x,gt.y,gt.z);return this}transformDirection(e){for(let t=0,i=this.count;t<i;t++)gt.fromBufferAttribute(this,t),gt.transformDirection(e),this.setXYZ(t,gt.x,gt.y,gt.z);return this}set(e,t=0){return this.array.set(e,t),this}getComponent(e,t){let i=this.array[e*this.itemSize+t];return this.normalized&&(i=Rr(i,this.array)),i}setComponent(e,t,i){return this.normalized&&(i=Vt(i,this.array)),this.array[e*this.itemSize+t]=i,this}getX(e){let t=this.array[e*this.itemSize];return this.normalized&&(t=Rr(t,this.array)),t}setX(e,t){return this.normalized&&(t=Vt(t,this.array)),this.array[e*this.itemSize]=t,this}getY(e){let t=this.array[e*this.itemSize+1];return this.normalized&&(t=Rr(t,this.array)),t}setY(e,t){return this.normalized&&(t=Vt(t,this.array)),this.array[e*this.itemSize+1]=t,this}getZ(e){let t=this.array[e*this.itemSize+2];return this.normalized&&(t=Rr(t,this.array)),t}setZ(e,t){return this.normalized&&(t=Vt(t,this.array)),this.array[e*this.itemSize+2]=t,this}getW(e){let t=this.array[e*this.itemSize+3];return this.normalized&&(t=Rr(t,this.array)),t}setW(e,t){return this.normalized&&(t=Vt(t,this.array)),this.array[e*this.itemSize+3]=t,this}setXY(e,t,i){return e*=this.itemSize,this.normalized&&(t=Vt(t,this.array),i=Vt(i,this.array)),this.array[e+0]=t,this.array[e+1]=i,this}setXYZ(e,t,i,n){return e*=this.itemSize,this.normalized&&(t=Vt(t,this.array),i=Vt(i,this.array),n=Vt(n,this.array)),this.array[e+0]=t,this.array[e+1]=i,this.array[e+2]=n,this}setXYZW(e,t,i,n,s){return e*=this.itemSize,this.normalized&&(t=Vt(t,this.array),i=Vt(i,this.array),n=Vt(n,this.array),s=Vt(s,this.array)),this.array[e+0]=t,this.array[e+1]=i,this.array[e+2]=n,this.array[e+3]=s,this}onUpload(e){return this.onUploadCallback=e,this}clone(){return new this.constructor(this.array,this.itemSize).copy(this)}toJSON(){let e={itemSize:this.itemSize,type:this.array.constructor.name,array:Array.from(this.array),normalized:this.normalized};return this.name!==""&&(e.name=this.name),this.usage!==jl&&(e.usage=this.usage),e}dispose(){this.dispatchEvent({type:"dispose"})}};var Wr=class extends Et{constructor(e,t,i){super(new Uint16Array(e),t,i)}};var Xr=class extends Et{constructor(e,t,i){super(new Uint32Array(e),t,i)}};var Ae=class extends Et{constructor(e,t,i){super(new Float32Array(e),t,i)}},Um=new pi,Lr=new A,Il=new A,fi=class{constructor(e=new A,t=-1){this.isSphere=!0,this.center=e,this.radius=t}set(e,t){return this.center.copy(e),this.radius=t,this}setFromPoints(e,t){let i=this.center;t!==void 0?i.copy(t):Um.setFromPoints(e).getCenter(i);let n=0;for(let s=0,a=e.length;s<a;s++)n=Math.max(n,i.distanceToSquared(e[s]));return this.radius=Math.sqrt(n),this}copy(e){return this.center.copy(e.center),this.radius=e.radius,this}isEmpty(){return this.radius<0}makeEmpty(){return this.center.set(0,0,0),this.radius=-1,this}containsPoint(e){return e.distanceToSquared(this.center)<=this.radius*this.radius}distanceToPoint(e){return e.distanceTo(this.center)-this.radius}intersectsSphere(e){let t=this.radius+e.radius;return e.center.distanceToSquared(this.center)<=t*t}intersectsBox(e){return e.intersectsSphere(this)}intersectsPlane(e){return Math.abs(e.distanceToPoint(this.center))<=this.radius}clampPoint(e,t){let i=this.center.distanceToSquared(e);return t.copy(e),i>this.radius*this.radius&&(t.sub(this.center).normalize(),t.multiplyScalar(this.radius).add(this.center)),t}getBoundingBox(e){return this.isEmpty()?(e.makeEmpty(),e):(e.set(this.center,this.center),e.expandByScalar(this.radius),e)}applyMatrix4(e){return this.center.applyMatrix4(e),this.radius=this.radius*e.getMaxScaleOnAxis(),this}translate(e){return this.center.add(e),this}expandByPoint(e){if(this.isEmpty())return this.center.copy(e),this.radius=0,this;Lr.subVectors(e,this.center);let t=Lr.lengthSq();if(t>this.radius*this.radius){let i=Math.sqrt(t),n=.5*(i-this.radius);this.center.addScaledVector(Lr,n/i),this.radius+=n}return this}union(e){return e.isEmpty()?this:this.isEmpty()?(this.copy(e),this):(this.center.equals(e.center)===!0?this.radius=Math.max(this.radius,e.radius):(Il.subVectors(e.center,this.center).setLength(e.radius),this.expandByPoint(Lr.copy(e.center).add(Il)),this.expandByPoint(Lr.copy(e.center).sub(Il))),this)}equals(e){return e.center.equals(this.center)&&e.radius===this.radius}clone(){return new this.constructor().copy(this)}toJSON(){return{radius:this.radius,center:this.center.toArray()}}fromJSON(e){return this.radius=e.radius,this.center.fromArray(e.center),this}},Dm=0,ti=new De,Pl=new ii,er=new A,qt=new pi,Ur=new pi,bt=new A,Je=class r extends Ei{constructor(){super(),this.isBufferGeometry=!0,Object.defineProperty(this,"id",{value:Dm++}),this.uuid=gr(),this.name="",this.type="BufferGeometry",this.index=null,this.indirect=null,this.indirectOffset=0,this.attributes={},this.morphAttributes={},this.morphTargetsRelative=!1,this.groups=[],this.boundingBox=null,this.boundingSphere=null,this.drawRange={start:0,count:1/0},this.userData={}}getIndex(){return this.index}setIndex(e){return Array.isArray(e)?this.index=new((function(t){for(let i=t.length-1;i>=0;--i)if(t[i]>=65535)return!0;return!1})(e)?Xr:Wr)(e,1):this.index=e,this}setIndirect(e,t=0){return this.indirect=e,this.indirectOffset=t,this}getIndirect(){return this.indirect}getAttribute(e){return this.attributes[e]}setAttribute(e,t){return this.attributes[e]=t,this}deleteAttribute(e){return delete this.attributes[e],this}hasAttribute(e){return this.attributes[e]!==void 0}addGroup(e,t,i=0){this.groups.push({start:e,count:t,materialIndex:i})}clearGroups(){this.groups=[]}setDrawRange(e,t){this.drawRange.start=e,this.drawRange.count=t}applyMatrix4(e){let t=this.attributes.position;t!==void 0&&(t.applyMatrix4(e),t.needsUpdate=!0);let i=this.attributes.normal;if(i!==void 0){let s=new Ue().getNormalMatrix(e);i.applyNormalMatrix(s),i.needsUpdate=!0}let n=this.attributes.tangent;return n!==void 0&&(n.transformDirection(e),n.needsUpdate=!0),this.boundingBox!==null&&this.computeBoundingBox(),this.boundingSphere!==null&&this.computeBoundingSphere(),this}applyQuaternion(e){return ti.makeRotationFromQuaternion(e),this.applyMatrix4(ti),this}rotateX(e){return ti.makeRotationX(e),this.applyMatrix4(ti),this}rotateY(e){return ti.makeRotationY(e),this.applyMatrix4(ti),this}rotateZ(e){return ti.makeRotationZ(e),this.applyMatrix4(ti),this}translate(e,t,i){return ti.makeTranslation(e,t,i),this.applyMatrix4(ti),this}scale(e,t,i){return ti.makeScale(e,t,i),this.applyMatrix4(ti),this}lookAt(e){return Pl.lookAt(e),Pl.updateMatrix(),this.applyMatrix4(Pl.matrix),this}center(){return this.computeBoundingBox(),this.boundingBox.getCenter(er).negate(),this.translate(er.x,er.y,er.z),this}setFromPoints(e){let t=this.getAttribute("position");if(t===void 0){let i=[];for(let n=0,s=e.length;n<s;n++){let a=e[n];i.push(a.x,a.y,a.z||0)}this.setAttribute("position",new Ae(i,3))}else{let i=Math.min(e.length,t.count);for(let n=0;n<i;n++){let s=e[n];t.setXYZ(n,s.x,s.y,s.z||0)}e.length>t.count&&we("BufferGeometry: Buffer size too small for points data. Use .dispose() and create a new geometry."),t.needsUpdate=!0}return this}computeBoundingBox(){this.boundingBox===null&&(this.boundingBox=new pi);let e=this.attributes.position,t=this.morphAttributes.position;if(e&&e.isGLBufferAttribute)return Te("BufferGeometry.computeBoundingBox(): GLBufferAttribute requires a manual bounding box.",this),void this.boundingBox.set(new A(-1/0,-1/0,-1/0),new A(1/0,1/0,1/0));if(e!==void 0){if(this.boundingBox.setFromBufferAttribute(e),t)for(let i=0,n=t.length;i<n;i++){let s=t[i];qt.setFromBufferAttribute(s),this.morphTargetsRelative?(bt.addVectors(this.boundingBox.min,qt.min),this.boundingBox.expandByPoint(bt),bt.addVectors(this.boundingBox.max,qt.max),this.boundingBox.expandByPoint(bt)):(this.boundingBox.expandByPoint(qt.min),this.boundingBox.expandByPoint(qt.max))}}else this.boundingBox.makeEmpty();(isNaN(this.boundingBox.min.x)||isNaN(this.boundingBox.min.y)||isNaN(this.boundingBox.min.z))&&Te('BufferGeometry.computeBoundingBox(): Computed min/max have NaN values. The "position" attribute is likely to have NaN values.',this)}computeBoundingSphere(){this.boundingSphere===null&&(this.boundingSphere=new fi);let e=this.attributes.position,t=this.morphAttributes.position;if(e&&e.isGLBufferAttribute)return Te("BufferGeometry.computeBoundingSphere(): GLBufferAttribute requires a manual bounding sphere.",this),void this.boundingSphere.set(new A,1/0);if(e){let i=this.boundingSphere.center;if(qt.setFromBufferAttribute(e),t)for(let s=0,a=t.length;s<a;s++){let o=t[s];Ur.setFromBufferAttribute(o),this.morphTargetsRelative?(bt.addVectors(qt.min,Ur.min),qt.expandByPoint(bt),bt.addVectors(qt.max,Ur.max),qt.expandByPoint(bt)):(qt.expandByPoint(Ur.min),qt.expandByPoint(Ur.max))}qt.getCenter(i);let n=0;for(let s=0,a=e.count;s<a;s++)bt.fromBufferAttribute(e,s),n=Math.max(n,i.distanceToSquared(bt));if(t)for(let s=0,a=t.length;s<a;s++){let o=t[s],l=this.morphTargetsRelative;for(let c=0,h=o.count;c<h;c++)bt.fromBufferAttribute(o,c),l&&(er.fromBufferAttribute(e,c),bt.add(er)),n=Math.max(n,i.distanceToSquared(bt))}this.boundingSphere.radius=Math.sqrt(n),isNaN(this.boundingSphere.radius)&&Te('BufferGeometry.computeBoundingSphere(): Computed radius is NaN. The "position" attribute is likely to have NaN values.',this)}}computeTangents(){let e=this.index,t=this.attributes;if(e===null||t.position===void 0||t.normal===void 0||t.uv===void 0)return void Te("BufferGeometry: .computeTangents() failed. Missing required attributes (index, position, normal or uv)");let i=t.position,n=t.normal,s=t.uv;this.hasAttribute("tangent")===!1&&this.setAttribute("tangent",new Et(new Float32Array(4*i.count),4));let a=this.getAttribute("tangent"),o=[],l=[];for(let F=0;F<i.count;F++)o[F]=new A,l[F]=new A;let c=new A,h=new A,u=new A,f=new ne,p=new ne,g=new ne,d=new A,_=new A;function m(F,I,P){c.fromBufferAttribute(i,F),h.fromBufferAttribute(i,I),u.fromBufferAttribute(i,P),f.fromBufferAttribute(s,F),p.fromBufferAttribute(s,I),g.fromBufferAttribute(s,P),h.sub(c),u.sub(c),p.sub(f),g.sub(f);let H=1/(p.x*g.y-g.x*p.y);isFinite(H)&&(d.copy(h).multiplyScalar(g.y).addScaledVector(u,-p.y).multiplyScalar(H),_.copy(u).multiplyScalar(p.x).addScaledVector(h,-g.x).multiplyScalar(H),o[F].add(d),o[I].add(d),o[P].add(d),l[F].add(_),l[I].add(_),l[P].add(_))}let v=this.groups;v.length===0&&(v=[{start:0,count:e.count}]);for(let F=0,I=v.length;F<I;++F){let P=v[F],H=P.start;for(let O=H,j=H+P.count;O<j;O+=3)m(e.getX(O+0),e.getX(O+1),e.getX(O+2))}let y=new A,w=new A,E=new A,M=new A;function D(F){E.fromBufferAttribute(n,F),M.copy(E);let I=o[F];y.copy(I),y.sub(E.multiplyScalar(E.dot(I))).normalize(),w.crossVectors(M,I);let P=w.dot(l[F])<0?-1:1;a.setXYZW(F,y.x,y.y,y.z,P)}for(let F=0,I=v.length;F<I;++F){let P=v[F],H=P.start;for(let O=H,j=H+P.count;O<j;O+=3)D(e.getX(O+0)),D(e.getX(O+1)),D(e.getX(O+2))}}computeVertexNormals(){let e=this.index,t=this.getAttribute("position");if(t!==void 0){let i=this.getAttribute("normal");if(i===void 0)i=new Et(new Float32Array(3*t.count),3),this.setAttribute("normal",i);else for(let f=0,p=i.count;f<p;f++)i.setXYZ(f,0,0,0);let n=new A,s=new A,a=new A,o=new A,l=new A,c=new A,h=new A,u=new A;if(e)for(let f=0,p=e.count;f<p;f+=3){let g=e.getX(f+0),d=e.getX(f+1),_=e.getX(f+2);n.fromBufferAttribute(t,g),s.fromBufferAttribute(t,d),a.fromBufferAttribute(t,_),h.subVectors(a,s),u.subVectors(n,s),h.cross(u),o.fromBufferAttribute(i,g),l.fromBufferAttribute(i,d),c.fromBufferAttribute(i,_),o.add(h),l.add(h),c.add(h),i.setXYZ(g,o.x,o.y,o.z),i.setXYZ(d,l.x,l.y,l.z),i.setXYZ(_,c.x,c.y,c.z)}else for(let f=0,p=t.count;f<p;f+=3)n.fromBufferAttribute(t,f+0),s.fromBufferAttribute(t,f+1),a.fromBufferAttribute(t,f+2),h.subVectors(a,s),u.subVectors(n,s),h.cross(u),i.setXYZ(f+0,h.x,h.y,h.z),i.setXYZ(f+1,h.x,h.y,h.z),i.setXYZ(f+2,h.x,h.y,h.z);this.normalizeNormals(),i.needsUpdate=!0}}normalizeNormals(){let e=this.attributes.normal;for(let t=0,i=e.count;t<i;t++)bt.fromBufferAttribute(e,t),bt.normalize(),e.setXYZ(t,bt.x,bt.y,bt.z)}toNonIndexed(){function e(o,l){let c=o.array,h=o.itemSize,u=o.normalized,f=new c.constructor(l.length*h),p=0,g=0;for(let d=0,_=l.length;d<_;d++){p=o.isInterleavedBufferAttribute?l[d]*o.data.stride+o.offset:l[d]*h;for(let m=0;m<h;m++)f[g++]=c[p++]}return new Et(f,h,u)}if(this.index===null)return we("BufferGeometry.toNonIndexed(): BufferGeometry is already non-indexed."),this;let t=new r,i=this.index.array,n=this.attributes;for(let o in n){let l=e(n[o],i);t.setAttribute(o,l)}let s=this.morphAttributes;for(let o in s){let l=[],c=s[o];for(let h=0,u=c.length;h<u;h++){let f=e(c[h],i);l.push(f)}t.morphAttributes[o]=l}t.morphTargetsRelative=this.morphTargetsRelative;let a=this.groups;for(let o=0,l=a.length;o<l;o++){let c=a[o];t.addGroup(c.start,c.count,c.materialIndex)}return t}toJSON(){let e={metadata:{version:4.7,type:"BufferGeometry",generator:"BufferGeometry.toJSON"}};if(e.uuid=this.uuid,e.type=this.type,this.name!==""&&(e.name=this.name),Object.keys(this.userData).length>0&&(e.userData=this.userData),this.parameters!==void 0){let l=this.parameters;for(let c in l)l[c]!==void 0&&(e[c]=l[c]);return e}e.data={attributes:{}};let t=this.index;t!==null&&(e.data.index={type:t.array.constructor.name,array:Array.prototype.slice.call(t.array)});let i=this.attributes;for(let l in i){let c=i[l];e.data.attributes[l]=c.toJSON(e.data)}let n={},s=!1;for(let l in this.morphAttributes){let c=this.morphAttributes[l],h=[];for(let u=0,f=c.length;u<f;u++){let p=c[u];h.push(p.toJSON(e.data))}h.length>0&&(n[l]=h,s=!0)}s&&(e.data.morphAttributes=n,e.data.morphTargetsRelative=this.morphTargetsRelative);let a=this.groups;a.length>0&&(e.data.groups=JSON.parse(JSON.stringify(a)));let o=this.boundingSphere;return o!==null&&(e.data.boundingSphere=o.toJSON()),e}clone(){return new this.constructor().copy(this)}copy(e){this.index=null,this.attributes={},this.morphAttributes={},this.groups=[],this.boundingBox=null,this.boundingSphere=null;let t={};this.name=e.name;let i=e.index;i!==null&&this.setIndex(i.clone());let n=e.attributes;for(let c in n){let h=n[c];this.setAttribute(c,h.clone(t))}let s=e.morphAttributes;for(let c in s){let h=[],u=s[c];for(let f=0,p=u.length;f<p;f++)h.push(u[f].clone(t));this.morphAttributes[c]=h}this.morphTargetsRelative=e.morphTargetsRelative;let a=e.groups;for(let c=0,h=a.length;c<h;c++){let u=a[c];this.addGroup(u.start,u.count,u.materialIndex)}let o=e.boundingBox;o!==null&&(this.boundingBox=o.clone());let l=e.boundingSphere;return l!==null&&(this.boundingSphere=l.clone()),this.drawRange.start=e.drawRange.start,this.drawRange.count=e.drawRange.count,this.userData=e.userData,this}dispose(){this.dispatchEvent({type:"dispose"})}};var hx=new A;var Nm=0,Mn=class extends Ei{constructor(){super(),this.isMaterial=!0,Object.defineProperty(this,"id",{value:Nm++}),this.uuid=gr(),this.name="",this.type="Material",this.blending=1,this.side=0,this.vertexColors=!1,this.opacity=1,this.transparent=!1,this.alphaHash=!1,this.blendSrc=204,this.blendDst=205,this.blendEquation=100,this.blendSrcAlpha=null,this.blendDstAlpha=null,this.blendEquationAlpha=null,this.blendColor=new je(0,0,0),this.blendAlpha=0,this.depthFunc=3,this.depthTest=!0,this.depthWrite=!0,this.stencilWriteMask=255,this.stencilFunc=519,this.stencilRef=0,this.stencilFuncMask=255,this.stencilFail=xn,this.stencilZFail=xn,this.stencilZPass=xn,this.stencilWrite=!1,this.clippingPlanes=null,this.clipIntersection=!1,this.clipShadows=!1,this.shadowSide=null,this.colorWrite=!0,this.precision=null,this.polygonOffset=!1,this.polygonOffsetFactor=0,this.polygonOffsetUnits=0,this.dithering=!1,this.alphaToCoverage=!1,this.premultipliedAlpha=!1,this.forceSinglePass=!1,this.allowOverride=!0,this.visible=!0,this.toneMapped=!0,this.userData={},this.version=0,this._alphaTest=0}get alphaTest(){return this._alphaTest}set alphaTest(e){this._alphaTest>0!=e>0&&this.version++,this._alphaTest=e}onBeforeRender(){}onBeforeCompile(){}customProgramCacheKey(){return this.onBeforeCompile.toString()}setValues(e){if(e!==void 0)for(let t in e){let i=e[t];if(i===void 0){we(`Material: parameter '${t}' has value of undefined.`);continue}let n=this[t];n!==void 0?n&&n.isColor?n.set(i):n&&n.isVector3&&i&&i.isVector3?n.copy(i):this[t]=i:we(`Material: '${t}' is not a property of THREE.${this.type}.`)}}toJSON(e){let t=e===void 0||typeof e=="string";t&&(e={textures:{},images:{}});let i={metadata:{version:4.7,type:"Material",generator:"Material.toJSON"}};function n(s){let a=[];for(let o in s){let l=s[o];delete l.metadata,a.push(l)}return a}if(i.uuid=this.uuid,i.type=this.type,this.name!==""&&(i.name=this.name),this.color&&this.color.isColor&&(i.color=this.color.getHex()),this.roughness!==void 0&&(i.roughness=this.roughness),this.metalness!==void 0&&(i.metalness=this.metalness),this.sheen!==void 0&&(i.sheen=this.sheen),this.sheenColor&&this.sheenColor.isColor&&(i.sheenColor=this.sheenColor.getHex()),this.sheenRoughness!==void 0&&(i.sheenRoughness=this.sheenRoughness),this.emissive&&this.emissive.isColor&&(i.emissive=this.emissive.getHex()),this.emissiveIntensity!==void 0&&this.emissiveIntensity!==1&&(i.emissiveIntensity=this.emissiveIntensity),this.specular&&this.specular.isColor&&(i.specular=this.specular.getHex()),this.specularIntensity!==void 0&&(i.specularIntensity=this.specularIntensity),this.specularColor&&this.specularColor.isColor&&(i.specularColor=this.specularColor.getHex()),this.shininess!==void 0&&(i.shininess=this.shininess),this.clearcoat!==void 0&&(i.clearcoat=this.clearcoat),this.clearcoatRoughness!==void 0&&(i.clearcoatRoughness=this.clearcoatRoughness),this.clearcoatMap&&this.clearcoatMap.isTexture&&(i.clearcoatMap=this.clearcoatMap.toJSON(e).uuid),this.clearcoatRoughnessMap&&this.clearcoatRoughnessMap.isTexture&&(i.clearcoatRoughnessMap=this.clearcoatRoughnessMap.toJSON(e).uuid),this.clearcoatNormalMap&&this.clearcoatNormalMap.isTexture&&(i.clearcoatNormalMap=this.clearcoatNormalMap.toJSON(e).uuid,i.clearcoatNormalScale=this.clearcoatNormalScale.toArray()),this.sheenColorMap&&this.sheenColorMap.isTexture&&(i.sheenColorMap=this.sheenColorMap.toJSON(e).uuid),this.sheenRoughnessMap&&this.sheenRoughnessMap.isTexture&&(i.sheenRoughnessMap=this.sheenRoughnessMap.toJSON(e).uuid),this.dispersion!==void 0&&(i.dispersion=this.dispersion),this.iridescence!==void 0&&(i.iridescence=this.iridescence),this.iridescenceIOR!==void 0&&(i.iridescenceIOR=this.iridescenceIOR),this.iridescenceThicknessRange!==void 0&&(i.iridescenceThicknessRange=this.iridescenceThicknessRange),this.iridescenceMap&&this.iridescenceMap.isTexture&&(i.iridescenceMap=this.iridescenceMap.toJSON(e).uuid),this.iridescenceThicknessMap&&this.iridescenceThicknessMap.isTexture&&(i.iridescenceThicknessMap=this.iridescenceThicknessMap.toJSON(e).uuid),this.anisotropy!==void 0&&(i.anisotropy=this.anisotropy),this.anisotropyRotation!==void 0&&(i.anisotropyRotation=this.anisotropyRotation),this.anisotropyMap&&this.anisotropyMap.isTexture&&(i.anisotropyMap=this.anisotropyMap.toJSON(e).uuid),this.map&&this.map.isTexture&&(i.map=this.map.toJSON(e).uuid),this.matcap&&this.matcap.isTexture&&(i.matcap=this.matcap.toJSON(e).uuid),this.alphaMap&&this.alphaMap.isTexture&&(i.alphaMap=this.alphaMap.toJSON(e).uuid),this.lightMap&&this.lightMap.isTexture&&(i.lightMap=this.lightMap.toJSON(e).uuid,i.lightMapIntensity=this.lightMapIntensity),this.aoMap&&this.aoMap.isTexture&&(i.aoMap=this.aoMap.toJSON(e).uuid,i.aoMapIntensity=this.aoMapIntensity),this.bumpMap&&this.bumpMap.isTexture&&(i.bumpMap=this.bumpMap.toJSON(e).uuid,i.bumpScale=this.bumpScale),this.normalMap&&this.normalMap.isTexture&&(i.normalMap=this.normalMap.toJSON(e).uuid,i.normalMapType=this.normalMapType,i.normalScale=this.normalScale.toArray()),this.displacementMap&&this.displacementMap.isTexture&&(i.displacementMap=this.displacementMap.toJSON(e).uuid,i.displacementScale=this.displacementScale,i.displacementBias=this.displacementBias),this.roughnessMap&&this.roughnessMap.isTexture&&(i.roughnessMap=this.roughnessMap.toJSON(e).uuid),this.metalnessMap&&this.metalnessMap.isTexture&&(i.metalnessMap=this.metalnessMap.toJSON(e).uuid),this.emissiveMap&&this.emissiveMap.isTexture&&(i.emissiveMap=this.emissiveMap.toJSON(e).uuid),this.specularMap&&this.specularMap.isTexture&&(i.specularMap=this.specularMap.toJSON(e).uuid),this.specularIntensityMap&&this.specularIntensityMap.isTexture&&(i.specularIntensityMap=this.specularIntensityMap.toJSON(e).uuid),this.specularColorMap&&this.specularColorMap.isTexture&&(i.specularColorMap=this.specularColorMap.toJSON(e).uuid),this.envMap&&this.envMap.isTexture&&(i.envMap=this.envMap.toJSON(e).uuid,this.combine!==void 0&&(i.combine=this.combine)),this.envMapRotation!==void 0&&(i.envMapRotation=this.envMapRotation.toArray()),this.envMapIntensity!==void 0&&(i.envMapIntensity=this.envMapIntensity),this.reflectivity!==void 0&&(i.reflectivity=this.reflectivity),this.refractionRatio!==void 0&&(i.refractionRatio=this.refractionRatio),this.gradientMap&&this.gradientMap.isTexture&&(i.gradientMap=this.gradientMap.toJSON(e).uuid),this.transmission!==void 0&&(i.transmission=this.transmission),this.transmissionMap&&this.transmissionMap.isTexture&&(i.transmissionMap=this.transmissionMap.toJSON(e).uuid),this.thickness!==void 0&&(i.thickness=this.thickness),this.thicknessMap&&this.thicknessMap.isTexture&&(i.thicknessMap=this.thicknessMap.toJSON(e).uuid),this.attenuationDistance!==void 0&&this.attenuationDistance!==1/0&&(i.attenuationDistance=this.attenuationDistance),this.attenuationColor!==void 0&&(i.attenuationColor=this.attenuationColor.getHex()),this.size!==void 0&&(i.size=this.size),this.shadowSide!==null&&(i.shadowSide=this.shadowSide),this.sizeAttenuation!==void 0&&(i.sizeAttenuation=this.sizeAttenuation),this.blending!==1&&(i.blending=this.blending),this.side!==0&&(i.side=this.side),this.vertexColors===!0&&(i.vertexColors=!0),this.opacity<1&&(i.opacity=this.opacity),this.transparent===!0&&(i.transparent=!0),this.blendSrc!==204&&(i.blendSrc=this.blendSrc),this.blendDst!==205&&(i.blendDst=this.blendDst),this.blendEquation!==100&&(i.blendEquation=this.blendEquation),this.blendSrcAlpha!==null&&(i.blendSrcAlpha=this.blendSrcAlpha),this.blendDstAlpha!==null&&(i.blendDstAlpha=this.blendDstAlpha),this.blendEquationAlpha!==null&&(i.blendEquationAlpha=this.blendEquationAlpha),this.blendColor&&this.blendColor.isColor&&(i.blendColor=this.blendColor.getHex()),this.blendAlpha!==0&&(i.blendAlpha=this.blendAlpha),this.depthFunc!==3&&(i.depthFunc=this.depthFunc),this.depthTest===!1&&(i.depthTest=this.depthTest),this.depthWrite===!1&&(i.depthWrite=this.depthWrite),this.colorWrite===!1&&(i.colorWrite=this.colorWrite),this.stencilWriteMask!==255&&(i.stencilWriteMask=this.stencilWriteMask),this.stencilFunc!==519&&(i.stencilFunc=this.stencilFunc),this.stencilRef!==0&&(i.stencilRef=this.stencilRef),this.stencilFuncMask!==255&&(i.stencilFuncMask=this.stencilFuncMask),this.stencilFail!==xn&&(i.stencilFail=this.stencilFail),this.stencilZFail!==xn&&(i.stencilZFail=this.stencilZFail),this.stencilZPass!==xn&&(i.stencilZPass=this.stencilZPass),this.stencilWrite===!0&&(i.stencilWrite=this.stencilWrite),this.rotation!==void 0&&this.rotation!==0&&(i.rotation=this.rotation),this.polygonOffset===!0&&(i.polygonOffset=!0),this.polygonOffsetFactor!==0&&(i.polygonOffsetFactor=this.polygonOffsetFactor),this.polygonOffsetUnits!==0&&(i.polygonOffsetUnits=this.polygonOffsetUnits),this.linewidth!==void 0&&this.linewidth!==1&&(i.linewidth=this.linewidth),this.dashSize!==void 0&&(i.dashSize=this.dashSize),this.gapSize!==void 0&&(i.gapSize=this.gapSize),this.scale!==void 0&&(i.scale=this.scale),this.dithering===!0&&(i.dithering=!0),this.alphaTest>0&&(i.alphaTest=this.alphaTest),this.alphaHash===!0&&(i.alphaHash=!0),this.alphaToCoverage===!0&&(i.alphaToCoverage=!0),this.premultipliedAlpha===!0&&(i.premultipliedAlpha=!0),this.forceSinglePass===!0&&(i.forceSinglePass=!0),this.allowOverride===!1&&(i.allowOverride=!1),this.wireframe===!0&&(i.wireframe=!0),this.wireframeLinewidth>1&&(i.wireframeLinewidth=this.wireframeLinewidth),this.wireframeLinecap!=="round"&&(i.wireframeLinecap=this.wireframeLinecap),this.wireframeLinejoin!=="round"&&(i.wireframeLinejoin=this.wireframeLinejoin),this.flatShading===!0&&(i.flatShading=!0),this.visible===!1&&(i.visible=!1),this.toneMapped===!1&&(i.toneMapped=!1),this.fog===!1&&(i.fog=!1),Object.keys(this.userData).length>0&&(i.userData=this.userData),t){let s=n(e.textures),a=n(e.images);s.length>0&&(i.textures=s),a.length>0&&(i.images=a)}return i}clone(){return new this.constructor().copy(this)}copy(e){this.name=e.name,this.blending=e.blending,this.side=e.side,this.vertexColors=e.vertexColors,this.opacity=e.opacity,this.transparent=e.transparent,this.blendSrc=e.blendSrc,this.blendDst=e.blendDst,this.blendEquation=e.blendEquation,this.blendSrcAlpha=e.blendSrcAlpha,this.blendDstAlpha=e.blendDstAlpha,this.blendEquationAlpha=e.blendEquationAlpha,this.blendColor.copy(e.blendColor),this.blendAlpha=e.blendAlpha,this.depthFunc=e.depthFunc,this.depthTest=e.depthTest,this.depthWrite=e.depthWrite,this.stencilWriteMask=e.stencilWriteMask,this.stencilFunc=e.stencilFunc,this.stencilRef=e.stencilRef,this.stencilFuncMask=e.stencilFuncMask,this.stencilFail=e.stencilFail,this.stencilZFail=e.stencilZFail,this.stencilZPass=e.stencilZPass,this.stencilWrite=e.stencilWrite;let t=e.clippingPlanes,i=null;if(t!==null){let n=t.length;i=new Array(n);for(let s=0;s!==n;++s)i[s]=t[s].clone()}return this.clippingPlanes=i,this.clipIntersection=e.clipIntersection,this.clipShadows=e.clipShadows,this.shadowSide=e.shadowSide,this.colorWrite=e.colorWrite,this.precision=e.precision,this.polygonOffset=e.polygonOffset,this.polygonOffsetFactor=e.polygonOffsetFactor,this.polygonOffsetUnits=e.polygonOffsetUnits,this.dithering=e.dithering,this.alphaTest=e.alphaTest,this.alphaHash=e.alphaHash,this.alphaToCoverage=e.alphaToCoverage,this.premultipliedAlpha=e.premultipliedAlpha,this.forceSinglePass=e.forceSinglePass,this.allowOverride=e.allowOverride,this.visible=e.visible,this.toneMapped=e.toneMapped,this.userData=JSON.parse(JSON.stringify(e.userData)),this}dispose(){this.dispatchEvent({type:"dispose"})}set needsUpdate(e){e===!0&&this.version++}};var ux=new A,dx=new A,px=new A,fx=new ne,mx=new ne,gx=new De,vx=new A,_x=new A,xx=new A,yx=new ne,Mx=new ne,Sx=new ne;var bx=new A,wx=new A;var Oi=new A,Ll=new A,Zs=new A,$i=new A,Ul=new A,Ks=new A,Dl=new A,Sn=class{constructor(e=new A,t=new A(0,0,-1)){this.origin=e,this.direction=t}set(e,t){return this.origin.copy(e),this.direction.copy(t),this}copy(e){return this.origin.copy(e.origin),this.direction.copy(e.direction),this}at(e,t){return t.copy(this.origin).addScaledVector(this.direction,e)}lookAt(e){return this.direction.copy(e).sub(this.origin).normalize(),this}recast(e){return this.origin.copy(this.at(e,Oi)),this}closestPointToPoint(e,t){t.subVectors(e,this.origin);let i=t.dot(this.direction);return i<0?t.copy(this.origin):t.copy(this.origin).addScaledVector(this.direction,i)}distanceToPoint(e){return Math.sqrt(this.distanceSqToPoint(e))}distanceSqToPoint(e){let t=Oi.subVectors(e,this.origin).dot(this.direction);return t<0?this.origin.distanceToSquared(e):(Oi.copy(this.origin).addScaledVector(this.direction,t),Oi.distanceToSquared(e))}distanceSqToSegment(e,t,i,n){Ll.copy(e).add(t).multiplyScalar(.5),Zs.copy(t).sub(e).normalize(),$i.copy(this.origin).sub(Ll);let s=.5*e.distanceTo(t),a=-this.direction.dot(Zs),o=$i.dot(this.direction),l=-$i.dot(Zs),c=$i.lengthSq(),h=Math.abs(1-a*a),u,f,p,g;if(h>0)if(u=a*l-o,f=a*o-l,g=s*h,u>=0)if(f>=-g)if(f<=g){let d=1/h;u*=d,f*=d,p=u*(u+a*f+2*o)+f*(a*u+f+2*l)+c}else f=s,u=Math.max(0,-(a*f+o)),p=-u*u+f*(f+2*l)+c;else f=-s,u=Math.max(0,-(a*f+o)),p=-u*u+f*(f+2*l)+c;else f<=-g?(u=Math.max(0,-(-a*s+o)),f=u>0?-s:Math.min(Math.max(-s,-l),s),p=-u*u+f*(f+2*l)+c):f<=g?(u=0,f=Math.min(Math.max(-s,-l),s),p=f*(f+2*l)+c):(u=Math.max(0,-(a*s+o)),f=u>0?s:Math.min(Math.max(-s,-l),s),p=-u*u+f*(f+2*l)+c);else f=a>0?-s:s,u=Math.max(0,-(a*f+o)),p=-u*u+f*(f+2*l)+c;return i&&i.copy(this.origin).addScaledVector(this.direction,u),n&&n.copy(Ll).addScaledVector(Zs,f),p}intersectSphere(e,t){Oi.subVectors(e.center,this.origin);let i=Oi.dot(this.direction),n=Oi.dot(Oi)-i*i,s=e.radius*e.radius;if(n>s)return null;let a=Math.sqrt(s-n),o=i-a,l=i+a;return l<0?null:o<0?this.at(l,t):this.at(o,t)}intersectsSphere(e){return!(e.radius<0)&&this.distanceSqToPoint(e.center)<=e.radius*e.radius}distanceToPlane(e){let t=e.normal.dot(this.direction);if(t===0)return e.distanceToPoint(this.origin)===0?0:null;let i=-(this.origin.dot(e.normal)+e.constant)/t;return i>=0?i:null}intersectPlane(e,t){let i=this.distanceToPlane(e);return i===null?null:this.at(i,t)}intersectsPlane(e){let t=e.distanceToPoint(this.origin);return t===0?!0:e.normal.dot(this.direction)*t<0}intersectBox(e,t){let i,n,s,a,o,l,c=1/this.direction.x,h=1/this.direction.y,u=1/this.direction.z,f=this.origin;return c>=0?(i=(e.min.x-f.x)*c,n=(e.max.x-f.x)*c):(i=(e.max.x-f.x)*c,n=(e.min.x-f.x)*c),h>=0?(s=(e.min.y-f.y)*h,a=(e.max.y-f.y)*h):(s=(e.max.y-f.y)*h,a=(e.min.y-f.y)*h),i>a||s>n?null:((s>i||isNaN(i))&&(i=s),(a<n||isNaN(n))&&(n=a),u>=0?(o=(e.min.z-f.z)*u,l=(e.max.z-f.z)*u):(o=(e.max.z-f.z)*u,l=(e.min.z-f.z)*u),i>l||o>n?null:((o>i||i!=i)&&(i=o),(l<n||n!=n)&&(n=l),n<0?null:this.at(i>=0?i:n,t)))}intersectsBox(e){return this.intersectBox(e,Oi)!==null}intersectTriangle(e,t,i,n,s){Ul.subVectors(t,e),Ks.subVectors(i,e),Dl.crossVectors(Ul,Ks);let a,o=this.direction.dot(Dl);if(o>0){if(n)return null;a=1}else{if(!(o<0))return null;a=-1,o=-o}$i.subVectors(this.origin,e);let l=a*this.direction.dot(Ks.crossVectors($i,Ks));if(l<0)return null;let c=a*this.direction.dot(Ul.cross($i));if(c<0||l+c>o)return null;let h=-a*$i.dot(Dl);return h<0?null:this.at(h/o,s)}applyMatrix4(e){return this.origin.applyMatrix4(e),this.direction.transformDirection(e),this}equals(e){return e.origin.equals(this.origin)&&e.direction.equals(this.direction)}clone(){return new this.constructor().copy(this)}},jr=class extends Mn{constructor(e){super(),this.isMeshBasicMaterial=!0,this.type="MeshBasicMaterial",this.color=new je(16777215),this.map=null,this.lightMap=null,this.lightMapIntensity=1,this.aoMap=null,this.aoMapIntensity=1,this.specularMap=null,this.alphaMap=null,this.envMap=null,this.envMapRotation=new tn,this.combine=0,this.reflectivity=1,this.refractionRatio=.98,this.wireframe=!1,this.wireframeLinewidth=1,this.wireframeLinecap="round",this.wireframeLinejoin="round",this.fog=!0,this.setValues(e)}copy(e){return super.copy(e),this.color.copy(e.color),this.map=e.map,this.lightMap=e.lightMap,this.lightMapIntensity=e.lightMapIntensity,this.aoMap=e.aoMap,this.aoMapIntensity=e.aoMapIntensity,this.specularMap=e.specularMap,this.alphaMap=e.alphaMap,this.envMap=e.envMap,this.envMapRotation.copy(e.envMapRotation),this.combine=e.combine,this.reflectivity=e.reflectivity,this.refractionRatio=e.refractionRatio,this.wireframe=e.wireframe,this.wireframeLinewidth=e.wireframeLinewidth,this.wireframeLinecap=e.wireframeLinecap,this.wireframeLinejoin=e.wireframeLinejoin,this.fog=e.fog,this}},qu=new De,vn=new Sn,$s=new fi,Yu=new A,Js=new A,Qs=new A,ea=new A,Nl=new A,ta=new A,Zu=new A,ia=new A,Ct=class extends ii{constructor(e=new Je,t=new jr){super(),this.isMesh=!0,this.type="Mesh",this.geometry=e,this.material=t,this.morphTargetDictionary=void 0,this.morphTargetInfluences=void 0,this.count=1,this.updateMorphTargets()}copy(e,t){return super.copy(e,t),e.morphTargetInfluences!==void 0&&(this.morphTargetInfluences=e.morphTargetInfluences.slice()),e.morphTargetDictionary!==void 0&&(this.morphTargetDictionary=Object.assign({},e.morphTargetDictionary)),this.material=Array.isArray(e.material)?e.material.slice():e.material,this.geometry=e.geometry,this}updateMorphTargets(){let e=this.geometry.morphAttributes,t=Object.keys(e);if(t.length>0){let i=e[t[0]];if(i!==void 0){this.morphTargetInfluences=[],this.morphTargetDictionary={};for(let n=0,s=i.length;n<s;n++){let a=i[n].name||String(n);this.morphTargetInfluences.push(0),this.morphTargetDictionary[a]=n}}}}getVertexPosition(e,t){let i=this.geometry,n=i.attributes.position,s=i.morphAttributes.position,a=i.morphTargetsRelative;t.fromBufferAttribute(n,e);let o=this.morphTargetInfluences;if(s&&o){ta.set(0,0,0);for(let l=0,c=s.length;l<c;l++){let h=o[l],u=s[l];h!==0&&(Nl.fromBufferAttribute(u,e),a?ta.addScaledVector(Nl,h):ta.addScaledVector(Nl.sub(t),h))}t.add(ta)}return t}raycast(e,t){let i=this.geometry,n=this.material,s=this.matrixWorld;if(n!==void 0){if(i.boundingSphere===null&&i.computeBoundingSphere(),$s.copy(i.boundingSphere),$s.applyMatrix4(s),vn.copy(e.ray).recast(e.near),$s.containsPoint(vn.origin)===!1&&(vn.intersectSphere($s,Yu)===null||vn.origin.distanceToSquared(Yu)>(e.far-e.near)**2))return;qu.copy(s).invert(),vn.copy(e.ray).applyMatrix4(qu),i.boundingBox!==null&&vn.intersectsBox(i.boundingBox)===!1||this._computeIntersections(e,t,vn)}}_computeIntersections(e,t,i){let n,s=this.geometry,a=this.material,o=s.index,l=s.attributes.position,c=s.attributes.uv,h=s.attributes.uv1,u=s.attributes.normal,f=s.groups,p=s.drawRange;if(o!==null)if(Array.isArray(a))for(let g=0,d=f.length;g<d;g++){let _=f[g],m=a[_.materialIndex];for(let v=Math.max(_.start,p.start),y=Math.min(o.count,Math.min(_.start+_.count,p.start+p.count));v<y;v+=3)n=na(this,m,e,i,c,h,u,o.getX(v),o.getX(v+1),o.getX(v+2)),n&&(n.faceIndex=Math.floor(v/3),n.face.materialIndex=_.materialIndex,t.push(n))}else for(let g=Math.max(0,p.start),d=Math.min(o.count,p.start+p.count);g<d;g+=3)n=na(this,a,e,i,c,h,u,o.getX(g),o.getX(g+1),o.getX(g+2)),n&&(n.faceIndex=Math.floor(g/3),t.push(n));else if(l!==void 0)if(Array.isArray(a))for(let g=0,d=f.length;g<d;g++){let _=f[g],m=a[_.materialIndex];for(let v=Math.max(_.start,p.start),y=Math.min(l.count,Math.min(_.start+_.count,p.start+p.count));v<y;v+=3)n=na(this,m,e,i,c,h,u,v,v+1,v+2),n&&(n.faceIndex=Math.floor(v/3),n.face.materialIndex=_.materialIndex,t.push(n))}else for(let g=Math.max(0,p.start),d=Math.min(l.count,p.start+p.count);g<d;g+=3)n=na(this,a,e,i,c,h,u,g,g+1,g+2),n&&(n.faceIndex=Math.floor(g/3),t.push(n))}};function na(r,e,t,i,n,s,a,o,l,c){r.getVertexPosition(o,Js),r.getVertexPosition(l,Qs),r.getVertexPosition(c,ea);let h=(function(u,f,p,g,d,_,m,v){let y;if(y=f.side===1?g.intersectTriangle(m,_,d,!0,v):g.intersectTriangle(d,_,m,f.side===0,v),y===null)return null;ia.copy(v),ia.applyMatrix4(u.matrixWorld);let w=p.ray.origin.distanceTo(ia);return w<p.near||w>p.far?null:{distance:w,point:ia.clone(),object:u}})(r,e,t,i,Js,Qs,ea,Zu);if(h){let u=new A;Bi.getBarycoord(Zu,Js,Qs,ea,u),n&&(h.uv=Bi.getInterpolatedAttribute(n,o,l,c,u,new ne)),s&&(h.uv1=Bi.getInterpolatedAttribute(s,o,l,c,u,new ne)),a&&(h.normal=Bi.getInterpolatedAttribute(a,o,l,c,u,new A),h.normal.dot(i.direction)>0&&h.normal.multiplyScalar(-1));let f={a:o,b:l,c,normal:new A,materialIndex:0};Bi.getNormal(Js,Qs,ea,f.normal),h.face=f,h.barycoord=u}return h}var Tx=new $e,Ex=new $e,Ax=new $e,Cx=new $e,Rx=new De,Ix=new A,Px=new fi,Lx=new De,Ux=new Sn;var bn=class extends Dt{constructor(e=null,t=1,i=1,n,s,a,o,l,c=1003,h=1003,u,f){super(null,a,o,l,c,h,n,s,u,f),this.isDataTexture=!0,this.image={data:e,width:t,height:i},this.generateMipmaps=!1,this.flipY=!1,this.unpackAlignment=1}},Dx=new De,Nx=new De;var Fx=new De,Ox=new De;var Bx=new pi,kx=new De,zx=new Ct,Gx=new fi;var Fl=new A,Fm=new A,Om=new Ue,wi=class{constructor(e=new A(1,0,0),t=0){this.isPlane=!0,this.normal=e,this.constant=t}set(e,t){return this.normal.copy(e),this.constant=t,this}setComponents(e,t,i,n){return this.normal.set(e,t,i),this.constant=n,this}setFromNormalAndCoplanarPoint(e,t){return this.normal.copy(e),this.constant=-t.dot(this.normal),this}setFromCoplanarPoints(e,t,i){let n=Fl.subVectors(i,t).cross(Fm.subVectors(e,t)).normalize();return this.setFromNormalAndCoplanarPoint(n,e),this}copy(e){return this.normal.copy(e.normal),this.constant=e.constant,this}normalize(){let e=1/this.normal.length();return this.normal.multiplyScalar(e),this.constant*=e,this}negate(){return this.constant*=-1,this.normal.negate(),this}distanceToPoint(e){return this.normal.dot(e)+this.constant}distanceToSphere(e){return this.distanceToPoint(e.center)-e.radius}projectPoint(e,t){return t.copy(e).addScaledVector(this.normal,-this.distanceToPoint(e))}intersectLine(e,t,i=!0){let n=e.delta(Fl),s=this.normal.dot(n);if(s===0)return this.distanceToPoint(e.start)===0?t.copy(e.start):null;let a=-(e.start.dot(this.normal)+this.constant)/s;return i===!0&&(a<0||a>1)?null:t.copy(e.start).addScaledVector(n,a)}intersectsLine(e){let t=this.distanceToPoint(e.start),i=this.distanceToPoint(e.end);return t<0&&i>0||i<0&&t>0}intersectsBox(e){return e.intersectsPlane(this)}intersectsSphere(e){return e.intersectsPlane(this)}coplanarPoint(e){return e.copy(this.normal).multiplyScalar(-this.constant)}applyMatrix4(e,t){let i=t||Om.getNormalMatrix(e),n=this.coplanarPoint(Fl).applyMatrix4(e),s=this.normal.applyMatrix3(i).normalize();return this.constant=-n.dot(s),this}translate(e){return this.constant-=e.dot(this.normal),this}equals(e){return e.normal.equals(this.normal)&&e.constant===this.constant}clone(){return new this.constructor().copy(this)}},_n=new fi,Bm=new ne(.5,.5),ra=new A,wn=class{constructor(e=new wi,t=new wi,i=new wi,n=new wi,s=new wi,a=new wi){this.planes=[e,t,i,n,s,a]}set(e,t,i,n,s,a){let o=this.planes;return o[0].copy(e),o[1].copy(t),o[2].copy(i),o[3].copy(n),o[4].copy(s),o[5].copy(a),this}copy(e){let t=this.planes;for(let i=0;i<6;i++)t[i].copy(e.planes[i]);return this}setFromProjectionMatrix(e,t=2e3,i=!1){let n=this.planes,s=e.elements,a=s[0],o=s[1],l=s[2],c=s[3],h=s[4],u=s[5],f=s[6],p=s[7],g=s[8],d=s[9],_=s[10],m=s[11],v=s[12],y=s[13],w=s[14],E=s[15];if(n[0].setComponents(c-a,p-h,m-g,E-v).normalize(),n[1].setComponents(c+a,p+h,m+g,E+v).normalize(),n[2].setComponents(c+o,p+u,m+d,E+y).normalize(),n[3].setComponents(c-o,p-u,m-d,E-y).normalize(),i)n[4].setComponents(l,f,_,w).normalize(),n[5].setComponents(c-l,p-f,m-_,E-w).normalize();else if(n[4].setComponents(c-l,p-f,m-_,E-w).normalize(),t===zi)n[5].setComponents(c+l,p+f,m+_,E+w).normalize();else{if(t!==zr)throw new Error("THREE.Frustum.setFromProjectionMatrix(): Invalid coordinate system: "+t);n[5].setComponents(l,f,_,w).normalize()}return this}intersectsObject(e){if(e.boundingSphere!==void 0)e.boundingSphere===null&&e.computeBoundingSphere(),_n.copy(e.boundingSphere).applyMatrix4(e.matrixWorld);else{let t=e.geometry;t.boundingSphere===null&&t.computeBoundingSphere(),_n.copy(t.boundingSphere).applyMatrix4(e.matrixWorld)}return this.intersectsSphere(_n)}intersectsSprite(e){_n.center.set(0,0,0);let t=Bm.distanceTo(e.center);return _n.radius=.7071067811865476+t,_n.applyMatrix4(e.matrixWorld),this.intersectsSphere(_n)}intersectsSphere(e){let t=this.planes,i=e.center,n=-e.radius;for(let s=0;s<6;s++)if(t[s].distanceToPoint(i)<n)return!1;return!0}intersectsBox(e){let t=this.planes;for(let i=0;i<6;i++){let n=t[i];if(ra.x=n.normal.x>0?e.max.x:e.min.x,ra.y=n.normal.y>0?e.max.y:e.min.y,ra.z=n.normal.z>0?e.max.z:e.min.z,n.distanceToPoint(ra)<0)return!1}return!0}containsPoint(e){let t=this.planes;for(let i=0;i<6;i++)if(t[i].distanceToPoint(e)<0)return!1;return!0}clone(){return new this.constructor().copy(this)}},Mi=new De,Si=new wn,ba=class r{constructor(){this.coordinateSystem=zi}intersectsObject(e,t){if(!t.isArrayCamera||t.cameras.length===0)return!1;for(let i=0;i<t.cameras.length;i++){let n=t.cameras[i];if(Mi.multiplyMatrices(n.projectionMatrix,n.matrixWorldInverse),Si.setFromProjectionMatrix(Mi,n.coordinateSystem,n.reversedDepth),Si.intersectsObject(e))return!0}return!1}intersectsSprite(e,t){if(!t||!t.cameras||t.cameras.length===0)return!1;for(let i=0;i<t.cameras.length;i++){let n=t.cameras[i];if(Mi.multiplyMatrices(n.projectionMatrix,n.matrixWorldInverse),Si.setFromProjectionMatrix(Mi,n.coordinateSystem,n.reversedDepth),Si.intersectsSprite(e))return!0}return!1}intersectsSphere(e,t){if(!t||!t.cameras||t.cameras.length===0)return!1;for(let i=0;i<t.cameras.length;i++){let n=t.cameras[i];if(Mi.multiplyMatrices(n.projectionMatrix,n.matrixWorldInverse),Si.setFromProjectionMatrix(Mi,n.coordinateSystem,n.reversedDepth),Si.intersectsSphere(e))return!0}return!1}intersectsBox(e,t){if(!t||!t.cameras||t.cameras.length===0)return!1;for(let i=0;i<t.cameras.length;i++){let n=t.cameras[i];if(Mi.multiplyMatrices(n.projectionMatrix,n.matrixWorldInverse),Si.setFromProjectionMatrix(Mi,n.coordinateSystem,n.reversedDepth),Si.intersectsBox(e))return!0}return!1}containsPoint(e,t){if(!t||!t.cameras||t.cameras.length===0)return!1;for(let i=0;i<t.cameras.length;i++){let n=t.cameras[i];if(Mi.multiplyMatrices(n.projectionMatrix,n.matrixWorldInverse),Si.setFromProjectionMatrix(Mi,n.coordinateSystem,n.reversedDepth),Si.containsPoint(e))return!0}return!1}clone(){return new r}};var ql=class{constructor(){this.index=0,this.pool=[],this.list=[]}push(e,t,i,n){let s=this.pool,a=this.list;this.index>=s.length&&s.push({start:-1,count:-1,z:-1,index:-1});let o=s[this.index];a.push(o),this.index++,o.start=e,o.count=t,o.z=i,o.index=n}reset(){this.list.length=0,this.index=0}},Vx=new De,Hx=new je(1,1,1),Wx=new wn,Xx=new ba,jx=new pi,qx=new fi,Yx=new A,Zx=new A,Kx=new A,$x=new ql,Jx=new Ct;var Qx=new A,ey=new A,ty=new De,iy=new Sn,ny=new fi,ry=new A,sy=new A;var ay=new A,oy=new A;var ly=new De,cy=new Sn,hy=new fi,uy=new A;var qr=class extends Dt{constructor(e=[],t=301,i,n,s,a,o,l,c,h){super(e,t,i,n,s,a,o,l,c,h),this.isCubeTexture=!0,this.flipY=!1}get images(){return this.image}set images(e){this.image=e}};var Gi=class extends Dt{constructor(e,t,i=1014,n,s,a,o=1003,l=1003,c,h=1026,u=1){if(h!==on&&h!==1027)throw new Error("DepthTexture format must be either THREE.DepthFormat or THREE.DepthStencilFormat");super({width:e,height:t,depth:u},n,s,a,o,l,h,i,c),this.isDepthTexture=!0,this.flipY=!1,this.generateMipmaps=!1,this.compareFunction=null}copy(e){return super.copy(e),this.source=new rr(Object.assign({},e.image)),this.compareFunction=e.compareFunction,this}toJSON(e){let t=super.toJSON(e);return this.compareFunction!==null&&(t.compareFunction=this.compareFunction),t}},wa=class extends Gi{constructor(e,t=1014,i=301,n,s,a=1003,o=1003,l,c=1026){let h={width:e,height:e,depth:1},u=[h,h,h,h,h,h];super(e,e,t,i,n,s,a,o,l,c),this.image=u,this.isCubeDepthTexture=!0,this.isCubeTexture=!0}get images(){return this.image}set images(e){this.image=e}},Yr=class extends Dt{constructor(e=null){super(),this.sourceTexture=e,this.isExternalTexture=!0}copy(e){return super.copy(e),this.sourceTexture=e.sourceTexture,this}},Tn=class r extends Je{constructor(e=1,t=1,i=1,n=1,s=1,a=1){super(),this.type="BoxGeometry",this.parameters={width:e,height:t,depth:i,widthSegments:n,heightSegments:s,depthSegments:a};let o=this;n=Math.floor(n),s=Math.floor(s),a=Math.floor(a);let l=[],c=[],h=[],u=[],f=0,p=0;function g(d,_,m,v,y,w,E,M,D,F,I){let P=w/D,H=E/F,O=w/2,j=E/2,z=M/2,k=D+1,q=F+1,X=0,oe=0,ue=new A;for(let be=0;be<q;be++){let ye=be*H-j;for(let xe=0;xe<k;xe++){let ee=xe*P-O;ue[d]=ee*v,ue[_]=ye*y,ue[m]=z,c.push(ue.x,ue.y,ue.z),ue[d]=0,ue[_]=0,ue[m]=M>0?1:-1,h.push(ue.x,ue.y,ue.z),u.push(xe/D),u.push(1-be/F),X+=1}}for(let be=0;be<F;be++)for(let ye=0;ye<D;ye++){let xe=f+ye+k*be,ee=f+ye+k*(be+1),ae=f+(ye+1)+k*(be+1),ie=f+(ye+1)+k*be;l.push(xe,ee,ie),l.push(ee,ae,ie),oe+=6}o.addGroup(p,oe,I),p+=oe,f+=X}g("z","y","x",-1,-1,i,t,e,a,s,0),g("z","y","x",1,-1,i,t,-e,a,s,1),g("x","z","y",1,1,e,i,t,n,a,2),g("x","z","y",1,-1,e,i,-t,n,a,3),g("x","y","z",1,-1,e,t,i,n,s,4),g("x","y","z",-1,-1,e,t,-i,n,s,5),this.setIndex(l),this.setAttribute("position",new Ae(c,3)),this.setAttribute("normal",new Ae(h,3)),this.setAttribute("uv",new Ae(u,2))}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}static fromJSON(e){return new r(e.width,e.height,e.depth,e.widthSegments,e.heightSegments,e.depthSegments)}},Ta=class r extends Je{constructor(e=1,t=1,i=4,n=8,s=1){super(),this.type="CapsuleGeometry",this.parameters={radius:e,height:t,capSegments:i,radialSegments:n,heightSegments:s},t=Math.max(0,t),i=Math.max(1,Math.floor(i)),n=Math.max(3,Math.floor(n)),s=Math.max(1,Math.floor(s));let a=[],o=[],l=[],c=[],h=t/2,u=Math.PI/2*e,f=t,p=2*u+f,g=2*i+s,d=n+1,_=new A,m=new A;for(let v=0;v<=g;v++){let y=0,w=0,E=0,M=0;if(v<=i){let I=v/i,P=I*Math.PI/2;w=-h-e*Math.cos(P),E=e*Math.sin(P),M=-e*Math.cos(P),y=I*u}else if(v<=i+s){let I=(v-i)/s;w=I*t-h,E=e,M=0,y=u+I*f}else{let I=(v-i-s)/i,P=I*Math.PI/2;w=h+e*Math.sin(P),E=e*Math.cos(P),M=e*Math.sin(P),y=u+f+I*u}let D=Math.max(0,Math.min(1,y/p)),F=0;v===0?F=.5/n:v===g&&(F=-.5/n);for(let I=0;I<=n;I++){let P=I/n,H=P*Math.PI*2,O=Math.sin(H),j=Math.cos(H);m.x=-E*j,m.y=w,m.z=E*O,o.push(m.x,m.y,m.z),_.set(-E*j,M,E*O),_.normalize(),l.push(_.x,_.y,_.z),c.push(P+F,D)}if(v>0){let I=(v-1)*d;for(let P=0;P<n;P++){let H=I+P,O=I+P+1,j=v*d+P,z=v*d+P+1;a.push(H,O,j),a.push(O,z,j)}}}this.setIndex(a),this.setAttribute("position",new Ae(o,3)),this.setAttribute("normal",new Ae(l,3)),this.setAttribute("uv",new Ae(c,2))}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}static fromJSON(e){return new r(e.radius,e.height,e.capSegments,e.radialSegments,e.heightSegments)}},Ea=class r extends Je{constructor(e=1,t=32,i=0,n=2*Math.PI){super(),this.type="CircleGeometry",this.parameters={radius:e,segments:t,thetaStart:i,thetaLength:n},t=Math.max(3,t);let s=[],a=[],o=[],l=[],c=new A,h=new ne;a.push(0,0,0),o.push(0,0,1),l.push(.5,.5);for(let u=0,f=3;u<=t;u++,f+=3){let p=i+u/t*n;c.x=e*Math.cos(p),c.y=e*Math.sin(p),a.push(c.x,c.y,c.z),o.push(0,0,1),h.x=(a[f]/e+1)/2,h.y=(a[f+1]/e+1)/2,l.push(h.x,h.y)}for(let u=1;u<=t;u++)s.push(u,u+1,0);this.setIndex(s),this.setAttribute("position",new Ae(a,3)),this.setAttribute("normal",new Ae(o,3)),this.setAttribute("uv",new Ae(l,2))}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}static fromJSON(e){return new r(e.radius,e.segments,e.thetaStart,e.thetaLength)}},Zr=class r extends Je{constructor(e=1,t=1,i=1,n=32,s=1,a=!1,o=0,l=2*Math.PI){super(),this.type="CylinderGeometry",this.parameters={radiusTop:e,radiusBottom:t,height:i,radialSegments:n,heightSegments:s,openEnded:a,thetaStart:o,thetaLength:l};let c=this;n=Math.floor(n),s=Math.floor(s);let h=[],u=[],f=[],p=[],g=0,d=[],_=i/2,m=0;function v(y){let w=g,E=new ne,M=new A,D=0,F=y===!0?e:t,I=y===!0?1:-1;for(let H=1;H<=n;H++)u.push(0,_*I,0),f.push(0,I,0),p.push(.5,.5),g++;let P=g;for(let H=0;H<=n;H++){let O=H/n*l+o,j=Math.cos(O),z=Math.sin(O);M.x=F*z,M.y=_*I,M.z=F*j,u.push(M.x,M.y,M.z),f.push(0,I,0),E.x=.5*j+.5,E.y=.5*z*I+.5,p.push(E.x,E.y),g++}for(let H=0;H<n;H++){let O=w+H,j=P+H;y===!0?h.push(j,j+1,O):h.push(j+1,j,O),D+=3}c.addGroup(m,D,y===!0?1:2),m+=D}(function(){let y=new A,w=new A,E=0,M=(t-e)/i;for(let D=0;D<=s;D++){let F=[],I=D/s,P=I*(t-e)+e;for(let H=0;H<=n;H++){let O=H/n,j=O*l+o,z=Math.sin(j),k=Math.cos(j);w.x=P*z,w.y=-I*i+_,w.z=P*k,u.push(w.x,w.y,w.z),y.set(z,M,k).normalize(),f.push(y.x,y.y,y.z),p.push(O,1-I),F.push(g++)}d.push(F)}for(let D=0;D<n;D++)for(let F=0;F<s;F++){let I=d[F][D],P=d[F+1][D],H=d[F+1][D+1],O=d[F][D+1];(e>0||F!==0)&&(h.push(I,P,O),E+=3),(t>0||F!==s-1)&&(h.push(P,H,O),E+=3)}c.addGroup(m,E,0),m+=E})(),a===!1&&(e>0&&v(!0),t>0&&v(!1)),this.setIndex(h),this.setAttribute("position",new Ae(u,3)),this.setAttribute("normal",new Ae(f,3)),this.setAttribute("uv",new Ae(p,2))}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}static fromJSON(e){return new r(e.radiusTop,e.radiusBottom,e.height,e.radialSegments,e.heightSegments,e.openEnded,e.thetaStart,e.thetaLength)}},Aa=class r extends Zr{constructor(e=1,t=1,i=32,n=1,s=!1,a=0,o=2*Math.PI){super(0,e,t,i,n,s,a,o),this.type="ConeGeometry",this.parameters={radius:e,height:t,radialSegments:i,heightSegments:n,openEnded:s,thetaStart:a,thetaLength:o}}static fromJSON(e){return new r(e.radius,e.height,e.radialSegments,e.heightSegments,e.openEnded,e.thetaStart,e.thetaLength)}},nn=class r extends Je{constructor(e=[],t=[],i=1,n=0){super(),this.type="PolyhedronGeometry",this.parameters={vertices:e,indices:t,radius:i,detail:n};let s=[],a=[];function o(p,g,d,_){let m=_+1,v=[];for(let y=0;y<=m;y++){v[y]=[];let w=p.clone().lerp(d,y/m),E=g.clone().lerp(d,y/m),M=m-y;for(let D=0;D<=M;D++)v[y][D]=D===0&&y===m?w:w.clone().lerp(E,D/M)}for(let y=0;y<m;y++)for(let w=0;w<2*(m-y)-1;w++){let E=Math.floor(w/2);w%2==0?(l(v[y][E+1]),l(v[y+1][E]),l(v[y][E])):(l(v[y][E+1]),l(v[y+1][E+1]),l(v[y+1][E]))}}function l(p){s.push(p.x,p.y,p.z)}function c(p,g){let d=3*p;g.x=e[d+0],g.y=e[d+1],g.z=e[d+2]}function h(p,g,d,_){_<0&&p.x===1&&(a[g]=p.x-1),d.x===0&&d.z===0&&(a[g]=_/2/Math.PI+.5)}function u(p){return Math.atan2(p.z,-p.x)}function f(p){return Math.atan2(-p.y,Math.sqrt(p.x*p.x+p.z*p.z))}(function(p){let g=new A,d=new A,_=new A;for(let m=0;m<t.length;m+=3)c(t[m+0],g),c(t[m+1],d),c(t[m+2],_),o(g,d,_,p)})(n),(function(p){let g=new A;for(let d=0;d<s.length;d+=3)g.x=s[d+0],g.y=s[d+1],g.z=s[d+2],g.normalize().multiplyScalar(p),s[d+0]=g.x,s[d+1]=g.y,s[d+2]=g.z})(i),(function(){let p=new A;for(let g=0;g<s.length;g+=3){p.x=s[g+0],p.y=s[g+1],p.z=s[g+2];let d=u(p)/2/Math.PI+.5,_=f(p)/Math.PI+.5;a.push(d,1-_)}(function(){let g=new A,d=new A,_=new A,m=new A,v=new ne,y=new ne,w=new ne;for(let E=0,M=0;E<s.length;E+=9,M+=6){g.set(s[E+0],s[E+1],s[E+2]),d.set(s[E+3],s[E+4],s[E+5]),_.set(s[E+6],s[E+7],s[E+8]),v.set(a[M+0],a[M+1]),y.set(a[M+2],a[M+3]),w.set(a[M+4],a[M+5]),m.copy(g).add(d).add(_).divideScalar(3);let D=u(m);h(v,M+0,g,D),h(y,M+2,d,D),h(w,M+4,_,D)}})(),(function(){for(let g=0;g<a.length;g+=6){let d=a[g+0],_=a[g+2],m=a[g+4],v=Math.max(d,_,m),y=Math.min(d,_,m);v>.9&&y<.1&&(d<.2&&(a[g+0]+=1),_<.2&&(a[g+2]+=1),m<.2&&(a[g+4]+=1))}})()})(),this.setAttribute("position",new Ae(s,3)),this.setAttribute("normal",new Ae(s.slice(),3)),this.setAttribute("uv",new Ae(a,2)),n===0?this.computeVertexNormals():this.normalizeNormals()}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}static fromJSON(e){return new r(e.vertices,e.indices,e.radius,e.detail)}},Ca=class r extends nn{constructor(e=1,t=0){let i=(1+Math.sqrt(5))/2,n=1/i;super([-1,-1,-1,-1,-1,1,-1,1,-1,-1,1,1,1,-1,-1,1,-1,1,1,1,-1,1,1,1,0,-n,-i,0,-n,i,0,n,-i,0,n,i,-n,-i,0,-n,i,0,n,-i,0,n,i,0,-i,0,-n,i,0,-n,-i,0,n,i,0,n],[3,11,7,3,7,15,3,15,13,7,19,17,7,17,6,7,6,15,17,4,8,17,8,10,17,10,6,8,0,16,8,16,2,8,2,10,0,12,1,0,1,18,0,18,16,6,10,2,6,2,13,6,13,15,2,16,18,2,18,3,2,3,13,18,1,9,18,9,11,18,11,3,4,14,12,4,12,0,4,0,8,11,9,5,11,5,19,11,19,7,19,5,14,19,14,4,19,4,17,1,12,14,1,14,5,1,5,9],e,t),this.type="DodecahedronGeometry",this.parameters={radius:e,detail:t}}static fromJSON(e){return new r(e.radius,e.detail)}},sa=new A,aa=new A,Ol=new A,oa=new Bi,Ra=class extends Je{constructor(e=null,t=1){if(super(),this.type="EdgesGeometry",this.parameters={geometry:e,thresholdAngle:t},e!==null){let n=Math.pow(10,4),s=Math.cos(fa*t),a=e.getIndex(),o=e.getAttribute("position"),l=a?a.count:o.count,c=[0,0,0],h=["a","b","c"],u=new Array(3),f={},p=[];for(let g=0;g<l;g+=3){a?(c[0]=a.getX(g),c[1]=a.getX(g+1),c[2]=a.getX(g+2)):(c[0]=g,c[1]=g+1,c[2]=g+2);let{a:d,b:_,c:m}=oa;if(d.fromBufferAttribute(o,c[0]),_.fromBufferAttribute(o,c[1]),m.fromBufferAttribute(o,c[2]),oa.getNormal(Ol),u[0]=`${Math.round(d.x*n)},${Math.round(d.y*n)},${Math.round(d.z*n)}`,u[1]=`${Math.round(_.x*n)},${Math.round(_.y*n)},${Math.round(_.z*n)}`,u[2]=`${Math.round(m.x*n)},${Math.round(m.y*n)},${Math.round(m.z*n)}`,u[0]!==u[1]&&u[1]!==u[2]&&u[2]!==u[0])for(let v=0;v<3;v++){let y=(v+1)%3,w=u[v],E=u[y],M=oa[h[v]],D=oa[h[y]],F=`${w}_${E}`,I=`${E}_${w}`;I in f&&f[I]?(Ol.dot(f[I].normal)<=s&&(p.push(M.x,M.y,M.z),p.push(D.x,D.y,D.z)),f[I]=null):F in f||(f[F]={index0:c[v],index1:c[y],normal:Ol.clone()})}}for(let g in f)if(f[g]){let{index0:d,index1:_}=f[g];sa.fromBufferAttribute(o,d),aa.fromBufferAttribute(o,_),p.push(sa.x,sa.y,sa.z),p.push(aa.x,aa.y,aa.z)}this.setAttribute("position",new Ae(p,3))}}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}},Kt=class{constructor(){this.type="Curve",this.arcLengthDivisions=200,this.needsUpdate=!1,this.cacheArcLengths=null}getPoint(){we("Curve: .getPoint() not implemented.")}getPointAt(e,t){let i=this.getUtoTmapping(e);return this.getPoint(i,t)}getPoints(e=5){let t=[];for(let i=0;i<=e;i++)t.push(this.getPoint(i/e));return t}getSpacedPoints(e=5){let t=[];for(let i=0;i<=e;i++)t.push(this.getPointAt(i/e));return t}getLength(){let e=this.getLengths();return e[e.length-1]}getLengths(e=this.arcLengthDivisions){if(this.cacheArcLengths&&this.cacheArcLengths.length===e+1&&!this.needsUpdate)return this.cacheArcLengths;this.needsUpdate=!1;let t=[],i,n=this.getPoint(0),s=0;t.push(0);for(let a=1;a<=e;a++)i=this.getPoint(a/e),s+=i.distanceTo(n),t.push(s),n=i;return this.cacheArcLengths=t,t}updateArcLengths(){this.needsUpdate=!0,this.getLengths()}getUtoTmapping(e,t=null){let i=this.getLengths(),n=0,s=i.length,a;a=t||e*i[s-1];let o,l=0,c=s-1;for(;l<=c;)if(n=Math.floor(l+(c-l)/2),o=i[n]-a,o<0)l=n+1;else{if(!(o>0)){c=n;break}c=n-1}if(n=c,i[n]===a)return n/(s-1);let h=i[n];return(n+(a-h)/(i[n+1]-h))/(s-1)}getTangent(e,t){let n=e-1e-4,s=e+1e-4;n<0&&(n=0),s>1&&(s=1);let a=this.getPoint(n),o=this.getPoint(s),l=t||(a.isVector2?new ne:new A);return l.copy(o).sub(a).normalize(),l}getTangentAt(e,t){let i=this.getUtoTmapping(e);return this.getTangent(i,t)}computeFrenetFrames(e,t=!1){let i=new A,n=[],s=[],a=[],o=new A,l=new De;for(let p=0;p<=e;p++){let g=p/e;n[p]=this.getTangentAt(g,new A)}s[0]=new A,a[0]=new A;let c=Number.MAX_VALUE,h=Math.abs(n[0].x),u=Math.abs(n[0].y),f=Math.abs(n[0].z);h<=c&&(c=h,i.set(1,0,0)),u<=c&&(c=u,i.set(0,1,0)),f<=c&&i.set(0,0,1),o.crossVectors(n[0],i).normalize(),s[0].crossVectors(n[0],o),a[0].crossVectors(n[0],s[0]);for(let p=1;p<=e;p++){if(s[p]=s[p-1].clone(),a[p]=a[p-1].clone(),o.crossVectors(n[p-1],n[p]),o.length()>Number.EPSILON){o.normalize();let g=Math.acos(Be(n[p-1].dot(n[p]),-1,1));s[p].applyMatrix4(l.makeRotationAxis(o,g))}a[p].crossVectors(n[p],s[p])}if(t===!0){let p=Math.acos(Be(s[0].dot(s[e]),-1,1));p/=e,n[0].dot(o.crossVectors(s[0],s[e]))>0&&(p=-p);for(let g=1;g<=e;g++)s[g].applyMatrix4(l.makeRotationAxis(n[g],p*g)),a[g].crossVectors(n[g],s[g])}return{tangents:n,normals:s,binormals:a}}clone(){return new this.constructor().copy(this)}copy(e){return this.arcLengthDivisions=e.arcLengthDivisions,this}toJSON(){let e={metadata:{version:4.7,type:"Curve",generator:"Curve.toJSON"}};return e.arcLengthDivisions=this.arcLengthDivisions,e.type=this.type,e}fromJSON(e){return this.arcLengthDivisions=e.arcLengthDivisions,this}},or=class extends Kt{constructor(e=0,t=0,i=1,n=1,s=0,a=2*Math.PI,o=!1,l=0){super(),this.isEllipseCurve=!0,this.type="EllipseCurve",this.aX=e,this.aY=t,this.xRadius=i,this.yRadius=n,this.aStartAngle=s,this.aEndAngle=a,this.aClockwise=o,this.aRotation=l}getPoint(e,t=new ne){let i=t,n=2*Math.PI,s=this.aEndAngle-this.aStartAngle,a=Math.abs(s)<Number.EPSILON;for(;s<0;)s+=n;for(;s>n;)s-=n;s<Number.EPSILON&&(s=a?0:n),this.aClockwise!==!0||a||(s===n?s=-n:s-=n);let o=this.aStartAngle+e*s,l=this.aX+this.xRadius*Math.cos(o),c=this.aY+this.yRadius*Math.sin(o);if(this.aRotation!==0){let h=Math.cos(this.aRotation),u=Math.sin(this.aRotation),f=l-this.aX,p=c-this.aY;l=f*h-p*u+this.aX,c=f*u+p*h+this.aY}return i.set(l,c)}copy(e){return super.copy(e),this.aX=e.aX,this.aY=e.aY,this.xRadius=e.xRadius,this.yRadius=e.yRadius,this.aStartAngle=e.aStartAngle,this.aEndAngle=e.aEndAngle,this.aClockwise=e.aClockwise,this.aRotation=e.aRotation,this}toJSON(){let e=super.toJSON();return e.aX=this.aX,e.aY=this.aY,e.xRadius=this.xRadius,e.yRadius=this.yRadius,e.aStartAngle=this.aStartAngle,e.aEndAngle=this.aEndAngle,e.aClockwise=this.aClockwise,e.aRotation=this.aRotation,e}fromJSON(e){return super.fromJSON(e),this.aX=e.aX,this.aY=e.aY,this.xRadius=e.xRadius,this.yRadius=e.yRadius,this.aStartAngle=e.aStartAngle,this.aEndAngle=e.aEndAngle,this.aClockwise=e.aClockwise,this.aRotation=e.aRotation,this}},Ia=class extends or{constructor(e,t,i,n,s,a){super(e,t,i,i,n,s,a),this.isArcCurve=!0,this.type="ArcCurve"}};function ih(){let r=0,e=0,t=0,i=0;function n(s,a,o,l){r=s,e=o,t=-3*s+3*a-2*o-l,i=2*s-2*a+o+l}return{initCatmullRom:function(s,a,o,l,c){n(a,o,c*(o-s),c*(l-a))},initNonuniformCatmullRom:function(s,a,o,l,c,h,u){let f=(a-s)/c-(o-s)/(c+h)+(o-a)/h,p=(o-a)/h-(l-a)/(h+u)+(l-o)/u;f*=h,p*=h,n(a,o,f,p)},calc:function(s){let a=s*s;return r+e*s+t*a+i*(a*s)}}}var Ku=new A,$u=new A,Bl=new ih,kl=new ih,zl=new ih,Pa=class extends Kt{constructor(e=[],t=!1,i="centripetal",n=.5){super(),this.isCatmullRomCurve3=!0,this.type="CatmullRomCurve3",this.points=e,this.closed=t,this.curveType=i,this.tension=n}getPoint(e,t=new A){let i=t,n=this.points,s=n.length,a=(s-(this.closed?0:1))*e,o,l,c=Math.floor(a),h=a-c;this.closed?c+=c>0?0:(Math.floor(Math.abs(c)/s)+1)*s:h===0&&c===s-1&&(c=s-2,h=1),this.closed||c>0?o=n[(c-1)%s]:($u.subVectors(n[0],n[1]).add(n[0]),o=$u);let u=n[c%s],f=n[(c+1)%s];if(this.closed||c+2<s?l=n[(c+2)%s]:(Ku.subVectors(n[s-1],n[s-2]).add(n[s-1]),l=Ku),this.curveType==="centripetal"||this.curveType==="chordal"){let p=this.curveType==="chordal"?.5:.25,g=Math.pow(o.distanceToSquared(u),p),d=Math.pow(u.distanceToSquared(f),p),_=Math.pow(f.distanceToSquared(l),p);d<1e-4&&(d=1),g<1e-4&&(g=d),_<1e-4&&(_=d),Bl.initNonuniformCatmullRom(o.x,u.x,f.x,l.x,g,d,_),kl.initNonuniformCatmullRom(o.y,u.y,f.y,l.y,g,d,_),zl.initNonuniformCatmullRom(o.z,u.z,f.z,l.z,g,d,_)}else this.curveType==="catmullrom"&&(Bl.initCatmullRom(o.x,u.x,f.x,l.x,this.tension),kl.initCatmullRom(o.y,u.y,f.y,l.y,this.tension),zl.initCatmullRom(o.z,u.z,f.z,l.z,this.tension));return i.set(Bl.calc(h),kl.calc(h),zl.calc(h)),i}copy(e){super.copy(e),this.points=[];for(let t=0,i=e.points.length;t<i;t++){let n=e.points[t];this.points.push(n.clone())}return this.closed=e.closed,this.curveType=e.curveType,this.tension=e.tension,this}toJSON(){let e=super.toJSON();e.points=[];for(let t=0,i=this.points.length;t<i;t++){let n=this.points[t];e.points.push(n.toArray())}return e.closed=this.closed,e.curveType=this.curveType,e.tension=this.tension,e}fromJSON(e){super.fromJSON(e),this.points=[];for(let t=0,i=e.points.length;t<i;t++){let n=e.points[t];this.points.push(new A().fromArray(n))}return this.closed=e.closed,this.curveType=e.curveType,this.tension=e.tension,this}};function Ju(r,e,t,i,n){let s=.5*(i-e),a=.5*(n-t),o=r*r;return(2*t-2*i+s+a)*(r*o)+(-3*t+3*i-2*s-a)*o+s*r+t}function Nr(r,e,t,i){return(function(n,s){let a=1-n;return a*a*s})(r,e)+(function(n,s){return 2*(1-n)*n*s})(r,t)+(function(n,s){return n*n*s})(r,i)}function Fr(r,e,t,i,n){return(function(s,a){let o=1-s;return o*o*o*a})(r,e)+(function(s,a){let o=1-s;return 3*o*o*s*a})(r,t)+(function(s,a){return 3*(1-s)*s*s*a})(r,i)+(function(s,a){return s*s*s*a})(r,n)}var Kr=class extends Kt{constructor(e=new ne,t=new ne,i=new ne,n=new ne){super(),this.isCubicBezierCurve=!0,this.type="CubicBezierCurve",this.v0=e,this.v1=t,this.v2=i,this.v3=n}getPoint(e,t=new ne){let i=t,n=this.v0,s=this.v1,a=this.v2,o=this.v3;return i.set(Fr(e,n.x,s.x,a.x,o.x),Fr(e,n.y,s.y,a.y,o.y)),i}copy(e){return super.copy(e),this.v0.copy(e.v0),this.v1.copy(e.v1),this.v2.copy(e.v2),this.v3.copy(e.v3),this}toJSON(){let e=super.toJSON();return e.v0=this.v0.toArray(),e.v1=this.v1.toArray(),e.v2=this.v2.toArray(),e.v3=this.v3.toArray(),e}fromJSON(e){return super.fromJSON(e),this.v0.fromArray(e.v0),this.v1.fromArray(e.v1),this.v2.fromArray(e.v2),this.v3.fromArray(e.v3),this}},La=class extends Kt{constructor(e=new A,t=new A,i=new A,n=new A){super(),this.isCubicBezierCurve3=!0,this.type="CubicBezierCurve3",this.v0=e,this.v1=t,this.v2=i,this.v3=n}getPoint(e,t=new A){let i=t,n=this.v0,s=this.v1,a=this.v2,o=this.v3;return i.set(Fr(e,n.x,s.x,a.x,o.x),Fr(e,n.y,s.y,a.y,o.y),Fr(e,n.z,s.z,a.z,o.z)),i}copy(e){return super.copy(e),this.v0.copy(e.v0),this.v1.copy(e.v1),this.v2.copy(e.v2),this.v3.copy(e.v3),this}toJSON(){let e=super.toJSON();return e.v0=this.v0.toArray(),e.v1=this.v1.toArray(),e.v2=this.v2.toArray(),e.v3=this.v3.toArray(),e}fromJSON(e){return super.fromJSON(e),this.v0.fromArray(e.v0),this.v1.fromArray(e.v1),this.v2.fromArray(e.v2),this.v3.fromArray(e.v3),this}},$r=class extends Kt{constructor(e=new ne,t=new ne){super(),this.isLineCurve=!0,this.type="LineCurve",this.v1=e,this.v2=t}getPoint(e,t=new ne){let i=t;return e===1?i.copy(this.v2):(i.copy(this.v2).sub(this.v1),i.multiplyScalar(e).add(this.v1)),i}getPointAt(e,t){return this.getPoint(e,t)}getTangent(e,t=new ne){return t.subVectors(this.v2,this.v1).normalize()}getTangentAt(e,t){return this.getTangent(e,t)}copy(e){return super.copy(e),this.v1.copy(e.v1),this.v2.copy(e.v2),this}toJSON(){let e=super.toJSON();return e.v1=this.v1.toArray(),e.v2=this.v2.toArray(),e}fromJSON(e){return super.fromJSON(e),this.v1.fromArray(e.v1),this.v2.fromArray(e.v2),this}},Ua=class extends Kt{constructor(e=new A,t=new A){super(),this.isLineCurve3=!0,this.type="LineCurve3",this.v1=e,this.v2=t}getPoint(e,t=new A){let i=t;return e===1?i.copy(this.v2):(i.copy(this.v2).sub(this.v1),i.multiplyScalar(e).add(this.v1)),i}getPointAt(e,t){return this.getPoint(e,t)}getTangent(e,t=new A){return t.subVectors(this.v2,this.v1).normalize()}getTangentAt(e,t){return this.getTangent(e,t)}copy(e){return super.copy(e),this.v1.copy(e.v1),this.v2.copy(e.v2),this}toJSON(){let e=super.toJSON();return e.v1=this.v1.toArray(),e.v2=this.v2.toArray(),e}fromJSON(e){return super.fromJSON(e),this.v1.fromArray(e.v1),this.v2.fromArray(e.v2),this}},Jr=class extends Kt{constructor(e=new ne,t=new ne,i=new ne){super(),this.isQuadraticBezierCurve=!0,this.type="QuadraticBezierCurve",this.v0=e,this.v1=t,this.v2=i}getPoint(e,t=new ne){let i=t,n=this.v0,s=this.v1,a=this.v2;return i.set(Nr(e,n.x,s.x,a.x),Nr(e,n.y,s.y,a.y)),i}copy(e){return super.copy(e),this.v0.copy(e.v0),this.v1.copy(e.v1),this.v2.copy(e.v2),this}toJSON(){let e=super.toJSON();return e.v0=this.v0.toArray(),e.v1=this.v1.toArray(),e.v2=this.v2.toArray(),e}fromJSON(e){return super.fromJSON(e),this.v0.fromArray(e.v0),this.v1.fromArray(e.v1),this.v2.fromArray(e.v2),this}},Qr=class extends Kt{constructor(e=new A,t=new A,i=new A){super(),this.isQuadraticBezierCurve3=!0,this.type="QuadraticBezierCurve3",this.v0=e,this.v1=t,this.v2=i}getPoint(e,t=new A){let i=t,n=this.v0,s=this.v1,a=this.v2;return i.set(Nr(e,n.x,s.x,a.x),Nr(e,n.y,s.y,a.y),Nr(e,n.z,s.z,a.z)),i}copy(e){return super.copy(e),this.v0.copy(e.v0),this.v1.copy(e.v1),this.v2.copy(e.v2),this}toJSON(){let e=super.toJSON();return e.v0=this.v0.toArray(),e.v1=this.v1.toArray(),e.v2=this.v2.toArray(),e}fromJSON(e){return super.fromJSON(e),this.v0.fromArray(e.v0),this.v1.fromArray(e.v1),this.v2.fromArray(e.v2),this}},es=class extends Kt{constructor(e=[]){super(),this.isSplineCurve=!0,this.type="SplineCurve",this.points=e}getPoint(e,t=new ne){let i=t,n=this.points,s=(n.length-1)*e,a=Math.floor(s),o=s-a,l=n[a===0?a:a-1],c=n[a],h=n[a>n.length-2?n.length-1:a+1],u=n[a>n.length-3?n.length-1:a+2];return i.set(Ju(o,l.x,c.x,h.x,u.x),Ju(o,l.y,c.y,h.y,u.y)),i}copy(e){super.copy(e),this.points=[];for(let t=0,i=e.points.length;t<i;t++){let n=e.points[t];this.points.push(n.clone())}return this}toJSON(){let e=super.toJSON();e.points=[];for(let t=0,i=this.points.length;t<i;t++){let n=this.points[t];e.points.push(n.toArray())}return e}fromJSON(e){super.fromJSON(e),this.points=[];for(let t=0,i=e.points.length;t<i;t++){let n=e.points[t];this.points.push(new ne().fromArray(n))}return this}},Da=Object.freeze({__proto__:null,ArcCurve:Ia,CatmullRomCurve3:Pa,CubicBezierCurve:Kr,CubicBezierCurve3:La,EllipseCurve:or,LineCurve:$r,LineCurve3:Ua,QuadraticBezierCurve:Jr,QuadraticBezierCurve3:Qr,SplineCurve:es}),Na=class extends Kt{constructor(){super(),this.type="CurvePath",this.curves=[],this.autoClose=!1}add(e){this.curves.push(e)}closePath(){let e=this.curves[0].getPoint(0),t=this.curves[this.curves.length-1].getPoint(1);if(!e.equals(t)){let i=e.isVector2===!0?"LineCurve":"LineCurve3";this.curves.push(new Da[i](t,e))}return this}getPoint(e,t){let i=e*this.getLength(),n=this.getCurveLengths(),s=0;for(;s<n.length;){if(n[s]>=i){let a=n[s]-i,o=this.curves[s],l=o.getLength(),c=l===0?0:1-a/l;return o.getPointAt(c,t)}s++}return null}getLength(){let e=this.getCurveLengths();return e[e.length-1]}updateArcLengths(){this.needsUpdate=!0,this.cacheLengths=null,this.getCurveLengths()}getCurveLengths(){if(this.cacheLengths&&this.cacheLengths.length===this.curves.length)return this.cacheLengths;let e=[],t=0;for(let i=0,n=this.curves.length;i<n;i++)t+=this.curves[i].getLength(),e.push(t);return this.cacheLengths=e,e}getSpacedPoints(e=40){let t=[];for(let i=0;i<=e;i++)t.push(this.getPoint(i/e));return this.autoClose&&t.push(t[0]),t}getPoints(e=12){let t=[],i;for(let n=0,s=this.curves;n<s.length;n++){let a=s[n],o=a.isEllipseCurve?2*e:a.isLineCurve||a.isLineCurve3?1:a.isSplineCurve?e*a.points.length:e,l=a.getPoints(o);for(let c=0;c<l.length;c++){let h=l[c];i&&i.equals(h)||(t.push(h),i=h)}}return this.autoClose&&t.length>1&&!t[t.length-1].equals(t[0])&&t.push(t[0]),t}copy(e){super.copy(e),this.curves=[];for(let t=0,i=e.curves.length;t<i;t++){let n=e.curves[t];this.curves.push(n.clone())}return this.autoClose=e.autoClose,this}toJSON(){let e=super.toJSON();e.autoClose=this.autoClose,e.curves=[];for(let t=0,i=this.curves.length;t<i;t++){let n=this.curves[t];e.curves.push(n.toJSON())}return e}fromJSON(e){super.fromJSON(e),this.autoClose=e.autoClose,this.curves=[];for(let t=0,i=e.curves.length;t<i;t++){let n=e.curves[t];this.curves.push(new Da[n.type]().fromJSON(n))}return this}},ts=class extends Na{constructor(e){super(),this.type="Path",this.currentPoint=new ne,e&&this.setFromPoints(e)}setFromPoints(e){this.moveTo(e[0].x,e[0].y);for(let t=1,i=e.length;t<i;t++)this.lineTo(e[t].x,e[t].y);return this}moveTo(e,t){return this.currentPoint.set(e,t),this}lineTo(e,t){let i=new $r(this.currentPoint.clone(),new ne(e,t));return this.curves.push(i),this.currentPoint.set(e,t),this}quadraticCurveTo(e,t,i,n){let s=new Jr(this.currentPoint.clone(),new ne(e,t),new ne(i,n));return this.curves.push(s),this.currentPoint.set(i,n),this}bezierCurveTo(e,t,i,n,s,a){let o=new Kr(this.currentPoint.clone(),new ne(e,t),new ne(i,n),new ne(s,a));return this.curves.push(o),this.currentPoint.set(s,a),this}splineThru(e){let t=[this.currentPoint.clone()].concat(e),i=new es(t);return this.curves.push(i),this.currentPoint.copy(e[e.length-1]),this}arc(e,t,i,n,s,a){let o=this.currentPoint.x,l=this.currentPoint.y;return this.absarc(e+o,t+l,i,n,s,a),this}absarc(e,t,i,n,s,a){return this.absellipse(e,t,i,i,n,s,a),this}ellipse(e,t,i,n,s,a,o,l){let c=this.currentPoint.x,h=this.currentPoint.y;return this.absellipse(e+c,t+h,i,n,s,a,o,l),this}absellipse(e,t,i,n,s,a,o,l){let c=new or(e,t,i,n,s,a,o,l);if(this.curves.length>0){let u=c.getPoint(0);u.equals(this.currentPoint)||this.lineTo(u.x,u.y)}this.curves.push(c);let h=c.getPoint(1);return this.currentPoint.copy(h),this}copy(e){return super.copy(e),this.currentPoint.copy(e.currentPoint),this}toJSON(){let e=super.toJSON();return e.currentPoint=this.currentPoint.toArray(),e}fromJSON(e){return super.fromJSON(e),this.currentPoint.fromArray(e.currentPoint),this}},is=class extends ts{constructor(e){super(e),this.uuid=gr(),this.type="Shape",this.holes=[]}getPointsHoles(e){let t=[];for(let i=0,n=this.holes.length;i<n;i++)t[i]=this.holes[i].getPoints(e);return t}extractPoints(e){return{shape:this.getPoints(e),holes:this.getPointsHoles(e)}}copy(e){super.copy(e),this.holes=[];for(let t=0,i=e.holes.length;t<i;t++){let n=e.holes[t];this.holes.push(n.clone())}return this}toJSON(){let e=super.toJSON();e.uuid=this.uuid,e.holes=[];for(let t=0,i=this.holes.length;t<i;t++){let n=this.holes[t];e.holes.push(n.toJSON())}return e}fromJSON(e){super.fromJSON(e),this.uuid=e.uuid,this.holes=[];for(let t=0,i=e.holes.length;t<i;t++){let n=e.holes[t];this.holes.push(new ts().fromJSON(n))}return this}};function km(r,e,t=2){let i=e&&e.length,n=i?e[0]*t:r.length,s=Qu(r,0,n,t,!0),a=[];if(!s||s.next===s.prev)return a;let o,l,c;if(i&&(s=(function(h,u,f,p){let g=[];for(let d=0,_=u.length;d<_;d++){let m=Qu(h,u[d]*p,d<_-1?u[d+1]*p:h.length,p,!1);m===m.next&&(m.steiner=!0),g.push(qm(m))}g.sort(Wm);for(let d=0;d<g.length;d++)f=Xm(g[d],f);return f})(r,e,s,t)),r.length>80*t){o=r[0],l=r[1];let h=o,u=l;for(let f=t;f<n;f+=t){let p=r[f],g=r[f+1];p<o&&(o=p),g<l&&(l=g),p>h&&(h=p),g>u&&(u=g)}c=Math.max(h-o,u-l),c=c!==0?32767/c:0}return ns(s,a,t,o,l,c,0),a}function Qu(r,e,t,i,n){let s;if(n===(function(a,o,l,c){let h=0;for(let u=o,f=l-c;u<l;u+=c)h+=(a[f]-a[u])*(a[u+1]+a[f+1]),f=u;return h})(r,e,t,i)>0)for(let a=e;a<t;a+=i)s=ed(a/i|0,r[a],r[a+1],s);else for(let a=t-i;a>=e;a-=i)s=ed(a/i|0,r[a],r[a+1],s);return s&&lr(s,s.next)&&(ss(s),s=s.next),s}function En(r,e){if(!r)return r;e||(e=r);let t,i=r;do if(t=!1,i.steiner||!lr(i,i.next)&&ct(i.prev,i,i.next)!==0)i=i.next;else{if(ss(i),i=e=i.prev,i===i.next)break;t=!0}while(t||i!==e);return e}function ns(r,e,t,i,n,s,a){if(!r)return;!a&&s&&(function(l,c,h,u){let f=l;do f.z===0&&(f.z=Yl(f.x,f.y,c,h,u)),f.prevZ=f.prev,f.nextZ=f.next,f=f.next;while(f!==l);f.prevZ.nextZ=null,f.prevZ=null,(function(p){let g,d=1;do{let _,m=p;p=null;let v=null;for(g=0;m;){g++;let y=m,w=0;for(let M=0;M<d&&(w++,y=y.nextZ,y);M++);let E=d;for(;w>0||E>0&&y;)w!==0&&(E===0||!y||m.z<=y.z)?(_=m,m=m.nextZ,w--):(_=y,y=y.nextZ,E--),v?v.nextZ=_:p=_,_.prevZ=v,v=_;m=y}v.nextZ=null,d*=2}while(g>1)})(f)})(r,i,n,s);let o=r;for(;r.prev!==r.next;){let l=r.prev,c=r.next;if(s?Gm(r,i,n,s):zm(r))e.push(l.i,r.i,c.i),ss(r),r=c.next,o=c.next;else if((r=c)===o){a?a===1?ns(r=Vm(En(r),e),e,t,i,n,s,2):a===2&&Hm(r,e,t,i,n,s):ns(En(r),e,t,i,n,s,1);break}}}function zm(r){let e=r.prev,t=r,i=r.next;if(ct(e,t,i)>=0)return!1;let n=e.x,s=t.x,a=i.x,o=e.y,l=t.y,c=i.y,h=Math.min(n,s,a),u=Math.min(o,l,c),f=Math.max(n,s,a),p=Math.max(o,l,c),g=i.next;for(;g!==e;){if(g.x>=h&&g.x<=f&&g.y>=u&&g.y<=p&&Dr(n,o,s,l,a,c,g.x,g.y)&&ct(g.prev,g,g.next)>=0)return!1;g=g.next}return!0}function Gm(r,e,t,i){let n=r.prev,s=r,a=r.next;if(ct(n,s,a)>=0)return!1;let o=n.x,l=s.x,c=a.x,h=n.y,u=s.y,f=a.y,p=Math.min(o,l,c),g=Math.min(h,u,f),d=Math.max(o,l,c),_=Math.max(h,u,f),m=Yl(p,g,e,t,i),v=Yl(d,_,e,t,i),y=r.prevZ,w=r.nextZ;for(;y&&y.z>=m&&w&&w.z<=v;){if(y.x>=p&&y.x<=d&&y.y>=g&&y.y<=_&&y!==n&&y!==a&&Dr(o,h,l,u,c,f,y.x,y.y)&&ct(y.prev,y,y.next)>=0||(y=y.prevZ,w.x>=p&&w.x<=d&&w.y>=g&&w.y<=_&&w!==n&&w!==a&&Dr(o,h,l,u,c,f,w.x,w.y)&&ct(w.prev,w,w.next)>=0))return!1;w=w.nextZ}for(;y&&y.z>=m;){if(y.x>=p&&y.x<=d&&y.y>=g&&y.y<=_&&y!==n&&y!==a&&Dr(o,h,l,u,c,f,y.x,y.y)&&ct(y.prev,y,y.next)>=0)return!1;y=y.prevZ}for(;w&&w.z<=v;){if(w.x>=p&&w.x<=d&&w.y>=g&&w.y<=_&&w!==n&&w!==a&&Dr(o,h,l,u,c,f,w.x,w.y)&&ct(w.prev,w,w.next)>=0)return!1;w=w.nextZ}return!0}function Vm(r,e){let t=r;do{let i=t.prev,n=t.next.next;!lr(i,n)&&Zd(i,t,t.next,n)&&rs(i,n)&&rs(n,i)&&(e.push(i.i,t.i,n.i),ss(t),ss(t.next),t=r=n),t=t.next}while(t!==r);return En(t)}function Hm(r,e,t,i,n,s){let a=r;do{let o=a.next.next;for(;o!==a.prev;){if(a.i!==o.i&&Ym(a,o)){let l=Kd(a,o);return a=En(a,a.next),l=En(l,l.next),ns(a,e,t,i,n,s,0),void ns(l,e,t,i,n,s,0)}o=o.next}a=a.next}while(a!==r)}function Wm(r,e){let t=r.x-e.x;return t===0&&(t=r.y-e.y,t===0)&&(t=(r.next.y-r.y)/(r.next.x-r.x)-(e.next.y-e.y)/(e.next.x-e.x)),t}function Xm(r,e){let t=(function(n,s){let a=s,o=n.x,l=n.y,c,h=-1/0;if(lr(n,a))return a;do{if(lr(n,a.next))return a.next;if(l<=a.y&&l>=a.next.y&&a.next.y!==a.y){let d=a.x+(l-a.y)*(a.next.x-a.x)/(a.next.y-a.y);if(d<=o&&d>h&&(h=d,c=a.x<a.next.x?a:a.next,d===o))return c}a=a.next}while(a!==s);if(!c)return null;let u=c,f=c.x,p=c.y,g=1/0;a=c;do{if(o>=a.x&&a.x>=f&&o!==a.x&&Yd(l<p?o:h,l,f,p,l<p?h:o,l,a.x,a.y)){let d=Math.abs(l-a.y)/(o-a.x);rs(a,n)&&(d<g||d===g&&(a.x>c.x||a.x===c.x&&jm(c,a)))&&(c=a,g=d)}a=a.next}while(a!==u);return c})(r,e);if(!t)return e;let i=Kd(t,r);return En(i,i.next),En(t,t.next)}function jm(r,e){return ct(r.prev,r,e.prev)<0&&ct(e.next,r,r.next)<0}function Yl(r,e,t,i,n){return(r=1431655765&((r=858993459&((r=252645135&((r=16711935&((r=(r-t)*n|0)|r<<8))|r<<4))|r<<2))|r<<1))|(e=1431655765&((e=858993459&((e=252645135&((e=16711935&((e=(e-i)*n|0)|e<<8))|e<<4))|e<<2))|e<<1))<<1}function qm(r){let e=r,t=r;do(e.x<t.x||e.x===t.x&&e.y<t.y)&&(t=e),e=e.next;while(e!==r);return t}function Yd(r,e,t,i,n,s,a,o){return(n-a)*(e-o)>=(r-a)*(s-o)&&(r-a)*(i-o)>=(t-a)*(e-o)&&(t-a)*(s-o)>=(n-a)*(i-o)}function Dr(r,e,t,i,n,s,a,o){return!(r===a&&e===o)&&Yd(r,e,t,i,n,s,a,o)}function Ym(r,e){return r.next.i!==e.i&&r.prev.i!==e.i&&!(function(t,i){let n=t;do{if(n.i!==t.i&&n.next.i!==t.i&&n.i!==i.i&&n.next.i!==i.i&&Zd(n,n.next,t,i))return!0;n=n.next}while(n!==t);return!1})(r,e)&&(rs(r,e)&&rs(e,r)&&(function(t,i){let n=t,s=!1,a=(t.x+i.x)/2,o=(t.y+i.y)/2;do n.y>o!=n.next.y>o&&n.next.y!==n.y&&a<(n.next.x-n.x)*(o-n.y)/(n.next.y-n.y)+n.x&&(s=!s),n=n.next;while(n!==t);return s})(r,e)&&(ct(r.prev,r,e.prev)||ct(r,e.prev,e))||lr(r,e)&&ct(r.prev,r,r.next)>0&&ct(e.prev,e,e.next)>0)}function ct(r,e,t){return(e.y-r.y)*(t.x-e.x)-(e.x-r.x)*(t.y-e.y)}function lr(r,e){return r.x===e.x&&r.y===e.y}function Zd(r,e,t,i){let n=ca(ct(r,e,t)),s=ca(ct(r,e,i)),a=ca(ct(t,i,r)),o=ca(ct(t,i,e));return n!==s&&a!==o||!(n!==0||!la(r,t,e))||!(s!==0||!la(r,i,e))||!(a!==0||!la(t,r,i))||!(o!==0||!la(t,e,i))}function la(r,e,t){return e.x<=Math.max(r.x,t.x)&&e.x>=Math.min(r.x,t.x)&&e.y<=Math.max(r.y,t.y)&&e.y>=Math.min(r.y,t.y)}function ca(r){return r>0?1:r<0?-1:0}function rs(r,e){return ct(r.prev,r,r.next)<0?ct(r,e,r.next)>=0&&ct(r,r.prev,e)>=0:ct(r,e,r.prev)<0||ct(r,r.next,e)<0}function Kd(r,e){let t=Zl(r.i,r.x,r.y),i=Zl(e.i,e.x,e.y),n=r.next,s=e.prev;return r.next=e,e.prev=r,t.next=n,n.prev=t,i.next=t,t.prev=i,s.next=i,i.prev=s,i}function ed(r,e,t,i){let n=Zl(r,e,t);return i?(n.next=i.next,n.prev=i,i.next.prev=n,i.next=n):(n.prev=n,n.next=n),n}function ss(r){r.next.prev=r.prev,r.prev.next=r.next,r.prevZ&&(r.prevZ.nextZ=r.nextZ),r.nextZ&&(r.nextZ.prevZ=r.prevZ)}function Zl(r,e,t){return{i:r,x:e,y:t,prev:null,next:null,z:0,prevZ:null,nextZ:null,steiner:!1}}var Kl=class{static triangulate(e,t,i=2){return km(e,t,i)}},Ti=class r{static area(e){let t=e.length,i=0;for(let n=t-1,s=0;s<t;n=s++)i+=e[n].x*e[s].y-e[s].x*e[n].y;return .5*i}static isClockWise(e){return r.area(e)<0}static triangulateShape(e,t){let i=[],n=[],s=[];td(e),id(i,e);let a=e.length;t.forEach(td);for(let l=0;l<t.length;l++)n.push(a),a+=t[l].length,id(i,t[l]);let o=Kl.triangulate(i,n);for(let l=0;l<o.length;l+=3)s.push(o.slice(l,l+3));return s}};function td(r){let e=r.length;e>2&&r[e-1].equals(r[0])&&r.pop()}function id(r,e){for(let t=0;t<e.length;t++)r.push(e[t].x),r.push(e[t].y)}var Fa=class r extends Je{constructor(e=new is([new ne(.5,.5),new ne(-.5,.5),new ne(-.5,-.5),new ne(.5,-.5)]),t={}){super(),this.type="ExtrudeGeometry",this.parameters={shapes:e,options:t},e=Array.isArray(e)?e:[e];let i=this,n=[],s=[];for(let o=0,l=e.length;o<l;o++)a(e[o]);function a(o){let l=[],c=t.curveSegments!==void 0?t.curveSegments:12,h=t.steps!==void 0?t.steps:1,u=t.depth!==void 0?t.depth:1,f=t.bevelEnabled===void 0||t.bevelEnabled,p=t.bevelThickness!==void 0?t.bevelThickness:.2,g=t.bevelSize!==void 0?t.bevelSize:p-.1,d=t.bevelOffset!==void 0?t.bevelOffset:0,_=t.bevelSegments!==void 0?t.bevelSegments:3,m=t.extrudePath,v=t.UVGenerator!==void 0?t.UVGenerator:Zm,y,w,E,M,D,F=!1;if(m){y=m.getSpacedPoints(h),F=!0,f=!1;let C=!!m.isCatmullRomCurve3&&m.closed;w=m.computeFrenetFrames(h,C),E=new A,M=new A,D=new A}f||(_=0,p=0,g=0,d=0);let I=o.extractPoints(c),P=I.shape,H=I.holes;if(!Ti.isClockWise(P)){P=P.reverse();for(let C=0,N=H.length;C<N;C++){let x=H[C];Ti.isClockWise(x)&&(H[C]=x.reverse())}}function O(C){let N=10000000000000001e-36,x=C[0];for(let L=1;L<=C.length;L++){let U=L%C.length,T=C[U],V=T.x-x.x,W=T.y-x.y,$=V*V+W*W,Q=Math.max(Math.abs(T.x),Math.abs(T.y),Math.abs(x.x),Math.abs(x.y));$<=N*Q*Q?(C.splice(U,1),L--):x=T}}O(P),H.forEach(O);let j=H.length,z=P;for(let C=0;C<j;C++){let N=H[C];P=P.concat(N)}function k(C,N,x){return N||Te("ExtrudeGeometry: vec does not exist"),C.clone().addScaledVector(N,x)}let q=P.length;function X(C,N,x){let L,U,T,V=C.x-N.x,W=C.y-N.y,$=x.x-C.x,Q=x.y-C.y,de=V*V+W*W,Z=V*Q-W*$;if(Math.abs(Z)>Number.EPSILON){let fe=Math.sqrt(de),ce=Math.sqrt($*$+Q*Q),pe=N.x-W/fe,se=N.y+V/fe,Me=((x.x-Q/ce-pe)*Q-(x.y+$/ce-se)*$)/(V*Q-W*$);L=pe+V*Me-C.x,U=se+W*Me-C.y;let ze=L*L+U*U;if(ze<=2)return new ne(L,U);T=Math.sqrt(ze/2)}else{let fe=!1;V>Number.EPSILON?$>Number.EPSILON&&(fe=!0):V<-Number.EPSILON?$<-Number.EPSILON&&(fe=!0):Math.sign(W)===Math.sign(Q)&&(fe=!0),fe?(L=-W,U=V,T=Math.sqrt(de)):(L=V,U=W,T=Math.sqrt(de/2))}return new ne(L/T,U/T)}let oe=[];for(let C=0,N=z.length,x=N-1,L=C+1;C<N;C++,x++,L++)x===N&&(x=0),L===N&&(L=0),oe[C]=X(z[C],z[x],z[L]);let ue=[],be,ye,xe=oe.concat();for(let C=0,N=j;C<N;C++){let x=H[C];be=[];for(let L=0,U=x.length,T=U-1,V=L+1;L<U;L++,T++,V++)T===U&&(T=0),V===U&&(V=0),be[L]=X(x[L],x[T],x[V]);ue.push(be),xe=xe.concat(be)}if(_===0)ye=Ti.triangulateShape(z,H);else{let C=[],N=[];for(let x=0;x<_;x++){let L=x/_,U=p*Math.cos(L*Math.PI/2),T=g*Math.sin(L*Math.PI/2)+d;for(let V=0,W=z.length;V<W;V++){let $=k(z[V],oe[V],T);ve($.x,$.y,-U),L===0&&C.push($)}for(let V=0,W=j;V<W;V++){let $=H[V];be=ue[V];let Q=[];for(let de=0,Z=$.length;de<Z;de++){let fe=k($[de],be[de],T);ve(fe.x,fe.y,-U),L===0&&Q.push(fe)}L===0&&N.push(Q)}}ye=Ti.triangulateShape(C,N)}let ee=ye.length,ae=g+d;for(let C=0;C<q;C++){let N=f?k(P[C],xe[C],ae):P[C];F?(M.copy(w.normals[0]).multiplyScalar(N.x),E.copy(w.binormals[0]).multiplyScalar(N.y),D.copy(y[0]).add(M).add(E),ve(D.x,D.y,D.z)):ve(N.x,N.y,0)}for(let C=1;C<=h;C++)for(let N=0;N<q;N++){let x=f?k(P[N],xe[N],ae):P[N];F?(M.copy(w.normals[C]).multiplyScalar(x.x),E.copy(w.binormals[C]).multiplyScalar(x.y),D.copy(y[C]).add(M).add(E),ve(D.x,D.y,D.z)):ve(x.x,x.y,u/h*C)}for(let C=_-1;C>=0;C--){let N=C/_,x=p*Math.cos(N*Math.PI/2),L=g*Math.sin(N*Math.PI/2)+d;for(let U=0,T=z.length;U<T;U++){let V=k(z[U],oe[U],L);ve(V.x,V.y,u+x)}for(let U=0,T=H.length;U<T;U++){let V=H[U];be=ue[U];for(let W=0,$=V.length;W<$;W++){let Q=k(V[W],be[W],L);F?ve(Q.x,Q.y+y[h-1].y,y[h-1].x+x):ve(Q.x,Q.y,u+x)}}}function ie(C,N){let x=C.length;for(;--x>=0;){let L=x,U=x-1;U<0&&(U=C.length-1);for(let T=0,V=h+2*_;T<V;T++){let W=q*T,$=q*(T+1);te(N+L+W,N+U+W,N+U+$,N+L+$)}}}function ve(C,N,x){l.push(C),l.push(N),l.push(x)}function ke(C,N,x){R(C),R(N),R(x);let L=n.length/3,U=v.generateTopUV(i,n,L-3,L-2,L-1);S(U[0]),S(U[1]),S(U[2])}function te(C,N,x,L){R(C),R(N),R(L),R(N),R(x),R(L);let U=n.length/3,T=v.generateSideWallUV(i,n,U-6,U-3,U-2,U-1);S(T[0]),S(T[1]),S(T[3]),S(T[1]),S(T[2]),S(T[3])}function R(C){n.push(l[3*C+0]),n.push(l[3*C+1]),n.push(l[3*C+2])}function S(C){s.push(C.x),s.push(C.y)}(function(){let C=n.length/3;if(f){let N=0,x=q*N;for(let L=0;L<ee;L++){let U=ye[L];ke(U[2]+x,U[1]+x,U[0]+x)}N=h+2*_,x=q*N;for(let L=0;L<ee;L++){let U=ye[L];ke(U[0]+x,U[1]+x,U[2]+x)}}else{for(let N=0;N<ee;N++){let x=ye[N];ke(x[2],x[1],x[0])}for(let N=0;N<ee;N++){let x=ye[N];ke(x[0]+q*h,x[1]+q*h,x[2]+q*h)}}i.addGroup(C,n.length/3-C,0)})(),(function(){let C=n.length/3,N=0;ie(z,N),N+=z.length;for(let x=0,L=H.length;x<L;x++){let U=H[x];ie(U,N),N+=U.length}i.addGroup(C,n.length/3-C,1)})()}this.setAttribute("position",new Ae(n,3)),this.setAttribute("uv",new Ae(s,2)),this.computeVertexNormals()}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}toJSON(){let e=super.toJSON();return(function(t,i,n){if(n.shapes=[],Array.isArray(t))for(let s=0,a=t.length;s<a;s++){let o=t[s];n.shapes.push(o.uuid)}else n.shapes.push(t.uuid);return n.options=Object.assign({},i),i.extrudePath!==void 0&&(n.options.extrudePath=i.extrudePath.toJSON()),n})(this.parameters.shapes,this.parameters.options,e)}static fromJSON(e,t){let i=[];for(let s=0,a=e.shapes.length;s<a;s++){let o=t[e.shapes[s]];i.push(o)}let n=e.options.extrudePath;return n!==void 0&&(e.options.extrudePath=new Da[n.type]().fromJSON(n)),new r(i,e.options)}},Zm={generateTopUV:function(r,e,t,i,n){let s=e[3*t],a=e[3*t+1],o=e[3*i],l=e[3*i+1],c=e[3*n],h=e[3*n+1];return[new ne(s,a),new ne(o,l),new ne(c,h)]},generateSideWallUV:function(r,e,t,i,n,s){let a=e[3*t],o=e[3*t+1],l=e[3*t+2],c=e[3*i],h=e[3*i+1],u=e[3*i+2],f=e[3*n],p=e[3*n+1],g=e[3*n+2],d=e[3*s],_=e[3*s+1],m=e[3*s+2];return Math.abs(o-h)<Math.abs(a-c)?[new ne(a,1-l),new ne(c,1-u),new ne(f,1-g),new ne(d,1-m)]:[new ne(o,1-l),new ne(h,1-u),new ne(p,1-g),new ne(_,1-m)]}},Oa=class r extends nn{constructor(e=1,t=0){let i=(1+Math.sqrt(5))/2;super([-1,i,0,1,i,0,-1,-i,0,1,-i,0,0,-1,i,0,1,i,0,-1,-i,0,1,-i,i,0,-1,i,0,1,-i,0,-1,-i,0,1],[0,11,5,0,5,1,0,1,7,0,7,10,0,10,11,1,5,9,5,11,4,11,10,2,10,7,6,7,1,8,3,9,4,3,4,2,3,2,6,3,6,8,3,8,9,4,9,5,2,4,11,6,2,10,8,6,7,9,8,1],e,t),this.type="IcosahedronGeometry",this.parameters={radius:e,detail:t}}static fromJSON(e){return new r(e.radius,e.detail)}},Ba=class r extends Je{constructor(e=[new ne(0,-.5),new ne(.5,0),new ne(0,.5)],t=12,i=0,n=2*Math.PI){super(),this.type="LatheGeometry",this.parameters={points:e,segments:t,phiStart:i,phiLength:n},t=Math.floor(t),n=Be(n,0,2*Math.PI);let s=[],a=[],o=[],l=[],c=[],h=1/t,u=new A,f=new ne,p=new A,g=new A,d=new A,_=0,m=0;for(let v=0;v<=e.length-1;v++)switch(v){case 0:_=e[v+1].x-e[v].x,m=e[v+1].y-e[v].y,p.x=1*m,p.y=-_,p.z=0*m,d.copy(p),p.normalize(),l.push(p.x,p.y,p.z);break;case e.length-1:l.push(d.x,d.y,d.z);break;default:_=e[v+1].x-e[v].x,m=e[v+1].y-e[v].y,p.x=1*m,p.y=-_,p.z=0*m,g.copy(p),p.x+=d.x,p.y+=d.y,p.z+=d.z,p.normalize(),l.push(p.x,p.y,p.z),d.copy(g)}for(let v=0;v<=t;v++){let y=i+v*h*n,w=Math.sin(y),E=Math.cos(y);for(let M=0;M<=e.length-1;M++){u.x=e[M].x*w,u.y=e[M].y,u.z=e[M].x*E,a.push(u.x,u.y,u.z),f.x=v/t,f.y=M/(e.length-1),o.push(f.x,f.y);let D=l[3*M+0]*w,F=l[3*M+1],I=l[3*M+0]*E;c.push(D,F,I)}}for(let v=0;v<t;v++)for(let y=0;y<e.length-1;y++){let w=y+v*e.length,E=w,M=w+e.length,D=w+e.length+1,F=w+1;s.push(E,M,F),s.push(D,F,M)}this.setIndex(s),this.setAttribute("position",new Ae(a,3)),this.setAttribute("uv",new Ae(o,2)),this.setAttribute("normal",new Ae(c,3))}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}static fromJSON(e){return new r(e.points,e.segments,e.phiStart,e.phiLength)}},ka=class r extends nn{constructor(e=1,t=0){super([1,0,0,-1,0,0,0,1,0,0,-1,0,0,0,1,0,0,-1],[0,2,4,0,4,3,0,3,5,0,5,2,1,2,5,1,5,3,1,3,4,1,4,2],e,t),this.type="OctahedronGeometry",this.parameters={radius:e,detail:t}}static fromJSON(e){return new r(e.radius,e.detail)}},cr=class r extends Je{constructor(e=1,t=1,i=1,n=1){super(),this.type="PlaneGeometry",this.parameters={width:e,height:t,widthSegments:i,heightSegments:n};let s=e/2,a=t/2,o=Math.floor(i),l=Math.floor(n),c=o+1,h=l+1,u=e/o,f=t/l,p=[],g=[],d=[],_=[];for(let m=0;m<h;m++){let v=m*f-a;for(let y=0;y<c;y++){let w=y*u-s;g.push(w,-v,0),d.push(0,0,1),_.push(y/o),_.push(1-m/l)}}for(let m=0;m<l;m++)for(let v=0;v<o;v++){let y=v+c*m,w=v+c*(m+1),E=v+1+c*(m+1),M=v+1+c*m;p.push(y,w,M),p.push(w,E,M)}this.setIndex(p),this.setAttribute("position",new Ae(g,3)),this.setAttribute("normal",new Ae(d,3)),this.setAttribute("uv",new Ae(_,2))}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}static fromJSON(e){return new r(e.width,e.height,e.widthSegments,e.heightSegments)}},za=class r extends Je{constructor(e=.5,t=1,i=32,n=1,s=0,a=2*Math.PI){super(),this.type="RingGeometry",this.parameters={innerRadius:e,outerRadius:t,thetaSegments:i,phiSegments:n,thetaStart:s,thetaLength:a},i=Math.max(3,i);let o=[],l=[],c=[],h=[],u=e,f=(t-e)/(n=Math.max(1,n)),p=new A,g=new ne;for(let d=0;d<=n;d++){for(let _=0;_<=i;_++){let m=s+_/i*a;p.x=u*Math.cos(m),p.y=u*Math.sin(m),l.push(p.x,p.y,p.z),c.push(0,0,1),g.x=(p.x/t+1)/2,g.y=(p.y/t+1)/2,h.push(g.x,g.y)}u+=f}for(let d=0;d<n;d++){let _=d*(i+1);for(let m=0;m<i;m++){let v=m+_,y=v,w=v+i+1,E=v+i+2,M=v+1;o.push(y,w,M),o.push(w,E,M)}}this.setIndex(o),this.setAttribute("position",new Ae(l,3)),this.setAttribute("normal",new Ae(c,3)),this.setAttribute("uv",new Ae(h,2))}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}static fromJSON(e){return new r(e.innerRadius,e.outerRadius,e.thetaSegments,e.phiSegments,e.thetaStart,e.thetaLength)}},Ga=class r extends Je{constructor(e=new is([new ne(0,.5),new ne(-.5,-.5),new ne(.5,-.5)]),t=12){super(),this.type="ShapeGeometry",this.parameters={shapes:e,curveSegments:t};let i=[],n=[],s=[],a=[],o=0,l=0;if(Array.isArray(e)===!1)c(e);else for(let h=0;h<e.length;h++)c(e[h]),this.addGroup(o,l,h),o+=l,l=0;function c(h){let u=n.length/3,f=h.extractPoints(t),p=f.shape,g=f.holes;Ti.isClockWise(p)===!1&&(p=p.reverse());for(let _=0,m=g.length;_<m;_++){let v=g[_];Ti.isClockWise(v)===!0&&(g[_]=v.reverse())}let d=Ti.triangulateShape(p,g);for(let _=0,m=g.length;_<m;_++){let v=g[_];p=p.concat(v)}for(let _=0,m=p.length;_<m;_++){let v=p[_];n.push(v.x,v.y,0),s.push(0,0,1),a.push(v.x,v.y)}for(let _=0,m=d.length;_<m;_++){let v=d[_],y=v[0]+u,w=v[1]+u,E=v[2]+u;i.push(y,w,E),l+=3}}this.setIndex(i),this.setAttribute("position",new Ae(n,3)),this.setAttribute("normal",new Ae(s,3)),this.setAttribute("uv",new Ae(a,2))}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}toJSON(){let e=super.toJSON();return(function(t,i){if(i.shapes=[],Array.isArray(t))for(let n=0,s=t.length;n<s;n++){let a=t[n];i.shapes.push(a.uuid)}else i.shapes.push(t.uuid);return i})(this.parameters.shapes,e)}static fromJSON(e,t){let i=[];for(let n=0,s=e.shapes.length;n<s;n++){let a=t[e.shapes[n]];i.push(a)}return new r(i,e.curveSegments)}},Va=class r extends Je{constructor(e=1,t=32,i=16,n=0,s=2*Math.PI,a=0,o=Math.PI){super(),this.type="SphereGeometry",this.parameters={radius:e,widthSegments:t,heightSegments:i,phiStart:n,phiLength:s,thetaStart:a,thetaLength:o},t=Math.max(3,Math.floor(t)),i=Math.max(2,Math.floor(i));let l=Math.min(a+o,Math.PI),c=0,h=[],u=new A,f=new A,p=[],g=[],d=[],_=[];for(let m=0;m<=i;m++){let v=[],y=m/i,w=0;m===0&&a===0?w=.5/t:m===i&&l===Math.PI&&(w=-.5/t);for(let E=0;E<=t;E++){let M=E/t;u.x=-e*Math.cos(n+M*s)*Math.sin(a+y*o),u.y=e*Math.cos(a+y*o),u.z=e*Math.sin(n+M*s)*Math.sin(a+y*o),g.push(u.x,u.y,u.z),f.copy(u).normalize(),d.push(f.x,f.y,f.z),_.push(M+w,1-y),v.push(c++)}h.push(v)}for(let m=0;m<i;m++)for(let v=0;v<t;v++){let y=h[m][v+1],w=h[m][v],E=h[m+1][v],M=h[m+1][v+1];(m!==0||a>0)&&p.push(y,w,M),(m!==i-1||l<Math.PI)&&p.push(w,E,M)}this.setIndex(p),this.setAttribute("position",new Ae(g,3)),this.setAttribute("normal",new Ae(d,3)),this.setAttribute("uv",new Ae(_,2))}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}static fromJSON(e){return new r(e.radius,e.widthSegments,e.heightSegments,e.phiStart,e.phiLength,e.thetaStart,e.thetaLength)}},Ha=class r extends nn{constructor(e=1,t=0){super([1,1,1,-1,-1,1,-1,1,-1,1,-1,-1],[2,1,0,0,3,2,1,3,0,2,3,1],e,t),this.type="TetrahedronGeometry",this.parameters={radius:e,detail:t}}static fromJSON(e){return new r(e.radius,e.detail)}},Wa=class r extends Je{constructor(e=1,t=.4,i=12,n=48,s=2*Math.PI,a=0,o=2*Math.PI){super(),this.type="TorusGeometry",this.parameters={radius:e,tube:t,radialSegments:i,tubularSegments:n,arc:s,thetaStart:a,thetaLength:o},i=Math.floor(i),n=Math.floor(n);let l=[],c=[],h=[],u=[],f=new A,p=new A,g=new A;for(let d=0;d<=i;d++){let _=a+d/i*o;for(let m=0;m<=n;m++){let v=m/n*s;p.x=(e+t*Math.cos(_))*Math.cos(v),p.y=(e+t*Math.cos(_))*Math.sin(v),p.z=t*Math.sin(_),c.push(p.x,p.y,p.z),f.x=e*Math.cos(v),f.y=e*Math.sin(v),g.subVectors(p,f).normalize(),h.push(g.x,g.y,g.z),u.push(m/n),u.push(d/i)}}for(let d=1;d<=i;d++)for(let _=1;_<=n;_++){let m=(n+1)*d+_-1,v=(n+1)*(d-1)+_-1,y=(n+1)*(d-1)+_,w=(n+1)*d+_;l.push(m,v,w),l.push(v,y,w)}this.setIndex(l),this.setAttribute("position",new Ae(c,3)),this.setAttribute("normal",new Ae(h,3)),this.setAttribute("uv",new Ae(u,2))}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}static fromJSON(e){return new r(e.radius,e.tube,e.radialSegments,e.tubularSegments,e.arc)}},Xa=class r extends Je{constructor(e=1,t=.4,i=64,n=8,s=2,a=3){super(),this.type="TorusKnotGeometry",this.parameters={radius:e,tube:t,tubularSegments:i,radialSegments:n,p:s,q:a},i=Math.floor(i),n=Math.floor(n);let o=[],l=[],c=[],h=[],u=new A,f=new A,p=new A,g=new A,d=new A,_=new A,m=new A;for(let y=0;y<=i;++y){let w=y/i*s*Math.PI*2;v(w,s,a,e,p),v(w+.01,s,a,e,g),_.subVectors(g,p),m.addVectors(g,p),d.crossVectors(_,m),m.crossVectors(d,_),d.normalize(),m.normalize();for(let E=0;E<=n;++E){let M=E/n*Math.PI*2,D=-t*Math.cos(M),F=t*Math.sin(M);u.x=p.x+(D*m.x+F*d.x),u.y=p.y+(D*m.y+F*d.y),u.z=p.z+(D*m.z+F*d.z),l.push(u.x,u.y,u.z),f.subVectors(u,p).normalize(),c.push(f.x,f.y,f.z),h.push(y/i),h.push(E/n)}}for(let y=1;y<=i;y++)for(let w=1;w<=n;w++){let E=(n+1)*(y-1)+(w-1),M=(n+1)*y+(w-1),D=(n+1)*y+w,F=(n+1)*(y-1)+w;o.push(E,M,F),o.push(M,D,F)}function v(y,w,E,M,D){let F=Math.cos(y),I=Math.sin(y),P=E/w*y,H=Math.cos(P);D.x=M*(2+H)*.5*F,D.y=M*(2+H)*I*.5,D.z=M*Math.sin(P)*.5}this.setIndex(o),this.setAttribute("position",new Ae(l,3)),this.setAttribute("normal",new Ae(c,3)),this.setAttribute("uv",new Ae(h,2))}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}static fromJSON(e){return new r(e.radius,e.tube,e.tubularSegments,e.radialSegments,e.p,e.q)}},ja=class r extends Je{constructor(e=new Qr(new A(-1,-1,0),new A(-1,1,0),new A(1,1,0)),t=64,i=1,n=8,s=!1){super(),this.type="TubeGeometry",this.parameters={path:e,tubularSegments:t,radius:i,radialSegments:n,closed:s};let a=e.computeFrenetFrames(t,s);this.tangents=a.tangents,this.normals=a.normals,this.binormals=a.binormals;let o=new A,l=new A,c=new ne,h=new A,u=[],f=[],p=[],g=[];function d(_){h=e.getPointAt(_/t,h);let m=a.normals[_],v=a.binormals[_];for(let y=0;y<=n;y++){let w=y/n*Math.PI*2,E=Math.sin(w),M=-Math.cos(w);l.x=M*m.x+E*v.x,l.y=M*m.y+E*v.y,l.z=M*m.z+E*v.z,l.normalize(),f.push(l.x,l.y,l.z),o.x=h.x+i*l.x,o.y=h.y+i*l.y,o.z=h.z+i*l.z,u.push(o.x,o.y,o.z)}}(function(){for(let _=0;_<t;_++)d(_);d(s===!1?t:0),(function(){for(let _=0;_<=t;_++)for(let m=0;m<=n;m++)c.x=_/t,c.y=m/n,p.push(c.x,c.y)})(),(function(){for(let _=1;_<=t;_++)for(let m=1;m<=n;m++){let v=(n+1)*(_-1)+(m-1),y=(n+1)*_+(m-1),w=(n+1)*_+m,E=(n+1)*(_-1)+m;g.push(v,y,E),g.push(y,w,E)}})()})(),this.setIndex(g),this.setAttribute("position",new Ae(u,3)),this.setAttribute("normal",new Ae(f,3)),this.setAttribute("uv",new Ae(p,2))}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}toJSON(){let e=super.toJSON();return e.path=this.parameters.path.toJSON(),e}static fromJSON(e){return new r(new Da[e.path.type]().fromJSON(e.path),e.tubularSegments,e.radius,e.radialSegments,e.closed)}},qa=class extends Je{constructor(e=null){if(super(),this.type="WireframeGeometry",this.parameters={geometry:e},e!==null){let t=[],i=new Set,n=new A,s=new A;if(e.index!==null){let a=e.attributes.position,o=e.index,l=e.groups;l.length===0&&(l=[{start:0,count:o.count,materialIndex:0}]);for(let c=0,h=l.length;c<h;++c){let u=l[c],f=u.start;for(let p=f,g=f+u.count;p<g;p+=3)for(let d=0;d<3;d++){let _=o.getX(p+d),m=o.getX(p+(d+1)%3);n.fromBufferAttribute(a,_),s.fromBufferAttribute(a,m),nd(n,s,i)===!0&&(t.push(n.x,n.y,n.z),t.push(s.x,s.y,s.z))}}}else{let a=e.attributes.position;for(let o=0,l=a.count/3;o<l;o++)for(let c=0;c<3;c++){let h=3*o+c,u=3*o+(c+1)%3;n.fromBufferAttribute(a,h),s.fromBufferAttribute(a,u),nd(n,s,i)===!0&&(t.push(n.x,n.y,n.z),t.push(s.x,s.y,s.z))}}this.setAttribute("position",new Ae(t,3))}}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}};function nd(r,e,t){let i=`${r.x},${r.y},${r.z}-${e.x},${e.y},${e.z}`,n=`${e.x},${e.y},${e.z}-${r.x},${r.y},${r.z}`;return t.has(i)!==!0&&t.has(n)!==!0&&(t.add(i),t.add(n),!0)}var dy=Object.freeze({__proto__:null,BoxGeometry:Tn,CapsuleGeometry:Ta,CircleGeometry:Ea,ConeGeometry:Aa,CylinderGeometry:Zr,DodecahedronGeometry:Ca,EdgesGeometry:Ra,ExtrudeGeometry:Fa,IcosahedronGeometry:Oa,LatheGeometry:Ba,OctahedronGeometry:ka,PlaneGeometry:cr,PolyhedronGeometry:nn,RingGeometry:za,ShapeGeometry:Ga,SphereGeometry:Va,TetrahedronGeometry:Ha,TorusGeometry:Wa,TorusKnotGeometry:Xa,TubeGeometry:ja,WireframeGeometry:qa});function Ln(r){let e={};for(let t in r){e[t]={};for(let i in r[t]){let n=r[t][i];if(rd(n))n.isRenderTargetTexture?(we("UniformsUtils: Textures of render targets cannot be cloned via cloneUniforms() or mergeUniforms()."),e[t][i]=null):e[t][i]=n.clone();else if(Array.isArray(n))if(rd(n[0])){let s=[];for(let a=0,o=n.length;a<o;a++)s[a]=n[a].clone();e[t][i]=s}else e[t][i]=n.slice();else e[t][i]=n}}return e}function Nt(r){let e={};for(let t=0;t<r.length;t++){let i=Ln(r[t]);for(let n in i)e[n]=i[n]}return e}function rd(r){return r&&(r.isColor||r.isMatrix3||r.isMatrix4||r.isVector2||r.isVector3||r.isVector4||r.isTexture||r.isQuaternion)}function nh(r){let e=r.getRenderTarget();return e===null?r.outputColorSpace:e.isXRRenderTarget===!0?e.texture.colorSpace:Ve.workingColorSpace}var $d={clone:Ln,merge:Nt},$t=class extends Mn{constructor(e){super(),this.isShaderMaterial=!0,this.type="ShaderMaterial",this.defines={},this.uniforms={},this.uniformsGroups=[],this.vertexShader=`void main() {
	gl_Position = projectionMatrix * modelViewMatrix * vec4( position, 1.0 );
}`,this.fragmentShader=`void main() {
	gl_FragColor = vec4( 1.0, 0.0, 0.0, 1.0 );
}`,this.linewidth=1,this.wireframe=!1,this.wireframeLinewidth=1,this.fog=!1,this.lights=!1,this.clipping=!1,this.forceSinglePass=!0,this.extensions={clipCullDistance:!1,multiDraw:!1},this.defaultAttributeValues={color:[1,1,1],uv:[0,0],uv1:[0,0]},this.index0AttributeName=void 0,this.uniformsNeedUpdate=!1,this.glslVersion=null,e!==void 0&&this.setValues(e)}copy(e){return super.copy(e),this.fragmentShader=e.fragmentShader,this.vertexShader=e.vertexShader,this.uniforms=Ln(e.uniforms),this.uniformsGroups=(function(t){let i=[];for(let n=0;n<t.length;n++)i.push(t[n].clone());return i})(e.uniformsGroups),this.defines=Object.assign({},e.defines),this.wireframe=e.wireframe,this.wireframeLinewidth=e.wireframeLinewidth,this.fog=e.fog,this.lights=e.lights,this.clipping=e.clipping,this.extensions=Object.assign({},e.extensions),this.glslVersion=e.glslVersion,this.defaultAttributeValues=Object.assign({},e.defaultAttributeValues),this.index0AttributeName=e.index0AttributeName,this.uniformsNeedUpdate=e.uniformsNeedUpdate,this}toJSON(e){let t=super.toJSON(e);t.glslVersion=this.glslVersion,t.uniforms={};for(let n in this.uniforms){let s=this.uniforms[n].value;s&&s.isTexture?t.uniforms[n]={type:"t",value:s.toJSON(e).uuid}:s&&s.isColor?t.uniforms[n]={type:"c",value:s.getHex()}:s&&s.isVector2?t.uniforms[n]={type:"v2",value:s.toArray()}:s&&s.isVector3?t.uniforms[n]={type:"v3",value:s.toArray()}:s&&s.isVector4?t.uniforms[n]={type:"v4",value:s.toArray()}:s&&s.isMatrix3?t.uniforms[n]={type:"m3",value:s.toArray()}:s&&s.isMatrix4?t.uniforms[n]={type:"m4",value:s.toArray()}:t.uniforms[n]={value:s}}Object.keys(this.defines).length>0&&(t.defines=this.defines),t.vertexShader=this.vertexShader,t.fragmentShader=this.fragmentShader,t.lights=this.lights,t.clipping=this.clipping;let i={};for(let n in this.extensions)this.extensions[n]===!0&&(i[n]=!0);return Object.keys(i).length>0&&(t.extensions=i),t}},hr=class extends $t{constructor(e){super(e),this.isRawShaderMaterial=!0,this.type="RawShaderMaterial"}};var Ya=class extends Mn{constructor(e){super(),this.isMeshDepthMaterial=!0,this.type="MeshDepthMaterial",this.depthPacking=3200,this.map=null,this.alphaMap=null,this.displacementMap=null,this.displacementScale=1,this.displacementBias=0,this.wireframe=!1,this.wireframeLinewidth=1,this.setValues(e)}copy(e){return super.copy(e),this.depthPacking=e.depthPacking,this.map=e.map,this.alphaMap=e.alphaMap,this.displacementMap=e.displacementMap,this.displacementScale=e.displacementScale,this.displacementBias=e.displacementBias,this.wireframe=e.wireframe,this.wireframeLinewidth=e.wireframeLinewidth,this}},Za=class extends Mn{constructor(e){super(),this.isMeshDistanceMaterial=!0,this.type="MeshDistanceMaterial",this.map=null,this.alphaMap=null,this.displacementMap=null,this.displacementScale=1,this.displacementBias=0,this.setValues(e)}copy(e){return super.copy(e),this.map=e.map,this.alphaMap=e.alphaMap,this.displacementMap=e.displacementMap,this.displacementScale=e.displacementScale,this.displacementBias=e.displacementBias,this}};function ha(r,e){return r&&r.constructor!==e?typeof e.BYTES_PER_ELEMENT=="number"?new e(r):Array.prototype.slice.call(r):r}var rn=class{constructor(e,t,i,n){this.parameterPositions=e,this._cachedIndex=0,this.resultBuffer=n!==void 0?n:new t.constructor(i),this.sampleValues=t,this.valueSize=i,this.settings=null,this.DefaultSettings_={}}evaluate(e){let t=this.parameterPositions,i=this._cachedIndex,n=t[i],s=t[i-1];e:{t:{let a;i:{n:if(!(e<n)){for(let o=i+2;;){if(n===void 0){if(e<s)break n;return i=t.length,this._cachedIndex=i,this.copySampleValue_(i-1)}if(i===o)break;if(s=n,n=t[++i],e<n)break t}a=t.length;break i}if(!(e>=s)){let o=t[1];e<o&&(i=2,s=o);for(let l=i-2;;){if(s===void 0)return this._cachedIndex=0,this.copySampleValue_(0);if(i===l)break;if(n=s,s=t[--i-1],e>=s)break t}a=i,i=0;break i}break e}for(;i<a;){let o=i+a>>>1;e<t[o]?a=o:i=o+1}if(n=t[i],s=t[i-1],s===void 0)return this._cachedIndex=0,this.copySampleValue_(0);if(n===void 0)return i=t.length,this._cachedIndex=i,this.copySampleValue_(i-1)}this._cachedIndex=i,this.intervalChanged_(i,s,n)}return this.interpolate_(i,s,e,n)}getSettings_(){return this.settings||this.DefaultSettings_}copySampleValue_(e){let t=this.resultBuffer,i=this.sampleValues,n=this.valueSize,s=e*n;for(let a=0;a!==n;++a)t[a]=i[s+a];return t}interpolate_(){throw new Error("call to abstract method")}intervalChanged_(){}},Ka=class extends rn{constructor(e,t,i,n){super(e,t,i,n),this._weightPrev=-0,this._offsetPrev=-0,this._weightNext=-0,this._offsetNext=-0,this.DefaultSettings_={endingStart:Hl,endingEnd:Hl}}intervalChanged_(e,t,i){let n=this.parameterPositions,s=e-2,a=e+1,o=n[s],l=n[a];if(o===void 0)switch(this.getSettings_().endingStart){case Wl:s=e,o=2*t-i;break;case Xl:s=n.length-2,o=t+n[s]-n[s+1];break;default:s=e,o=i}if(l===void 0)switch(this.getSettings_().endingEnd){case Wl:a=e,l=2*i-t;break;case Xl:a=1,l=i+n[1]-n[0];break;default:a=e-1,l=t}let c=.5*(i-t),h=this.valueSize;this._weightPrev=c/(t-o),this._weightNext=c/(l-i),this._offsetPrev=s*h,this._offsetNext=a*h}interpolate_(e,t,i,n){let s=this.resultBuffer,a=this.sampleValues,o=this.valueSize,l=e*o,c=l-o,h=this._offsetPrev,u=this._offsetNext,f=this._weightPrev,p=this._weightNext,g=(i-t)/(n-t),d=g*g,_=d*g,m=-f*_+2*f*d-f*g,v=(1+f)*_+(-1.5-2*f)*d+(-.5+f)*g+1,y=(-1-p)*_+(1.5+p)*d+.5*g,w=p*_-p*d;for(let E=0;E!==o;++E)s[E]=m*a[h+E]+v*a[c+E]+y*a[l+E]+w*a[u+E];return s}},$a=class extends rn{constructor(e,t,i,n){super(e,t,i,n)}interpolate_(e,t,i,n){let s=this.resultBuffer,a=this.sampleValues,o=this.valueSize,l=e*o,c=l-o,h=(i-t)/(n-t),u=1-h;for(let f=0;f!==o;++f)s[f]=a[c+f]*u+a[l+f]*h;return s}},Ja=class extends rn{constructor(e,t,i,n){super(e,t,i,n)}interpolate_(e){return this.copySampleValue_(e-1)}},Qa=class extends rn{interpolate_(e,t,i,n){let s=this.resultBuffer,a=this.sampleValues,o=this.valueSize,l=e*o,c=l-o,h=this.settings||this.DefaultSettings_,u=h.inTangents,f=h.outTangents;if(!u||!f){let d=(i-t)/(n-t),_=1-d;for(let m=0;m!==o;++m)s[m]=a[c+m]*_+a[l+m]*d;return s}let p=2*o,g=e-1;for(let d=0;d!==o;++d){let _=a[c+d],m=a[l+d],v=g*p+2*d,y=f[v],w=f[v+1],E=e*p+2*d,M=u[E],D=u[E+1],F,I,P,H,O,j=(i-t)/(n-t);for(let z=0;z<8;z++){F=j*j,I=F*j,P=1-j,H=P*P,O=H*P;let k=O*t+3*H*j*y+3*P*F*M+I*n-i;if(Math.abs(k)<1e-10)break;let q=3*H*(y-t)+6*P*j*(M-y)+3*F*(n-M);if(Math.abs(q)<1e-10)break;j-=k/q,j=Math.max(0,Math.min(1,j))}s[d]=O*_+3*H*j*w+3*P*F*D+I*m}return s}},Zt=class{constructor(e,t,i,n){if(e===void 0)throw new Error("THREE.KeyframeTrack: track name is undefined");if(t===void 0||t.length===0)throw new Error("THREE.KeyframeTrack: no keyframes in track named "+e);this.name=e,this.times=ha(t,this.TimeBufferType),this.values=ha(i,this.ValueBufferType),this.setInterpolation(n||this.DefaultInterpolation)}static toJSON(e){let t=e.constructor,i;if(t.toJSON!==this.toJSON)i=t.toJSON(e);else{i={name:e.name,times:ha(e.times,Array),values:ha(e.values,Array)};let n=e.getInterpolation();n!==e.DefaultInterpolation&&(i.interpolation=n)}return i.type=e.ValueTypeName,i}InterpolantFactoryMethodDiscrete(e){return new Ja(this.times,this.values,this.getValueSize(),e)}InterpolantFactoryMethodLinear(e){return new $a(this.times,this.values,this.getValueSize(),e)}InterpolantFactoryMethodSmooth(e){return new Ka(this.times,this.values,this.getValueSize(),e)}InterpolantFactoryMethodBezier(e){let t=new Qa(this.times,this.values,this.getValueSize(),e);return this.settings&&(t.settings=this.settings),t}setInterpolation(e){let t;switch(e){case Or:t=this.InterpolantFactoryMethodDiscrete;break;case va:t=this.InterpolantFactoryMethodLinear;break;case pa:t=this.InterpolantFactoryMethodSmooth;break;case Vl:t=this.InterpolantFactoryMethodBezier}if(t===void 0){let i="unsupported interpolation for "+this.ValueTypeName+" keyframe track named "+this.name;if(this.createInterpolant===void 0){if(e===this.DefaultInterpolation)throw new Error(i);this.setInterpolation(this.DefaultInterpolation)}return we("KeyframeTrack:",i),this}return this.createInterpolant=t,this}getInterpolation(){switch(this.createInterpolant){case this.InterpolantFactoryMethodDiscrete:return Or;case this.InterpolantFactoryMethodLinear:return va;case this.InterpolantFactoryMethodSmooth:return pa;case this.InterpolantFactoryMethodBezier:return Vl}}getValueSize(){return this.values.length/this.times.length}shift(e){if(e!==0){let t=this.times;for(let i=0,n=t.length;i!==n;++i)t[i]+=e}return this}scale(e){if(e!==1){let t=this.times;for(let i=0,n=t.length;i!==n;++i)t[i]*=e}return this}trim(e,t){let i=this.times,n=i.length,s=0,a=n-1;for(;s!==n&&i[s]<e;)++s;for(;a!==-1&&i[a]>t;)--a;if(++a,s!==0||a!==n){s>=a&&(a=Math.max(a,1),s=a-1);let o=this.getValueSize();this.times=i.slice(s,a),this.values=this.values.slice(s*o,a*o)}return this}validate(){let e=!0,t=this.getValueSize();t-Math.floor(t)!==0&&(Te("KeyframeTrack: Invalid value size in track.",this),e=!1);let i=this.times,n=this.values,s=i.length;s===0&&(Te("KeyframeTrack: Track is empty.",this),e=!1);let a=null;for(let o=0;o!==s;o++){let l=i[o];if(typeof l=="number"&&isNaN(l)){Te("KeyframeTrack: Time is not a valid number.",this,o,l),e=!1;break}if(a!==null&&a>l){Te("KeyframeTrack: Out of order keys.",this,o,l,a),e=!1;break}a=l}if(n!==void 0&&xm(n))for(let o=0,l=n.length;o!==l;++o){let c=n[o];if(isNaN(c)){Te("KeyframeTrack: Value is not a valid number.",this,o,c),e=!1;break}}return e}optimize(){let e=this.times.slice(),t=this.values.slice(),i=this.getValueSize(),n=this.getInterpolation()===pa,s=e.length-1,a=1;for(let o=1;o<s;++o){let l=!1,c=e[o];if(c!==e[o+1]&&(o!==1||c!==e[0]))if(n)l=!0;else{let h=o*i,u=h-i,f=h+i;for(let p=0;p!==i;++p){let g=t[h+p];if(g!==t[u+p]||g!==t[f+p]){l=!0;break}}}if(l){if(o!==a){e[a]=e[o];let h=o*i,u=a*i;for(let f=0;f!==i;++f)t[u+f]=t[h+f]}++a}}if(s>0){e[a]=e[s];for(let o=s*i,l=a*i,c=0;c!==i;++c)t[l+c]=t[o+c];++a}return a!==e.length?(this.times=e.slice(0,a),this.values=t.slice(0,a*i)):(this.times=e,this.values=t),this}clone(){let e=this.times.slice(),t=this.values.slice(),i=new this.constructor(this.name,e,t);return i.createInterpolant=this.createInterpolant,i}};Zt.prototype.ValueTypeName="",Zt.prototype.TimeBufferType=Float32Array,Zt.prototype.ValueBufferType=Float32Array,Zt.prototype.DefaultInterpolation=va;var Qi=class extends Zt{constructor(e,t,i){super(e,t,i)}};Qi.prototype.ValueTypeName="bool",Qi.prototype.ValueBufferType=Array,Qi.prototype.DefaultInterpolation=Or,Qi.prototype.InterpolantFactoryMethodLinear=void 0,Qi.prototype.InterpolantFactoryMethodSmooth=void 0;var eo=class extends Zt{constructor(e,t,i,n){super(e,t,i,n)}};eo.prototype.ValueTypeName="color";var to=class extends Zt{constructor(e,t,i,n){super(e,t,i,n)}};to.prototype.ValueTypeName="number";var io=class extends rn{constructor(e,t,i,n){super(e,t,i,n)}interpolate_(e,t,i,n){let s=this.resultBuffer,a=this.sampleValues,o=this.valueSize,l=(i-t)/(n-t),c=e*o;for(let h=c+o;c!==h;c+=4)ni.slerpFlat(s,0,a,c-o,a,c,l);return s}},as=class extends Zt{constructor(e,t,i,n){super(e,t,i,n)}InterpolantFactoryMethodLinear(e){return new io(this.times,this.values,this.getValueSize(),e)}};as.prototype.ValueTypeName="quaternion",as.prototype.InterpolantFactoryMethodSmooth=void 0;var en=class extends Zt{constructor(e,t,i){super(e,t,i)}};en.prototype.ValueTypeName="string",en.prototype.ValueBufferType=Array,en.prototype.DefaultInterpolation=Or,en.prototype.InterpolantFactoryMethodLinear=void 0,en.prototype.InterpolantFactoryMethodSmooth=void 0;var no=class extends Zt{constructor(e,t,i,n){super(e,t,i,n)}};no.prototype.ValueTypeName="vector";var ro=class{constructor(e,t,i){let n=this,s,a=!1,o=0,l=0,c=[];this.onStart=void 0,this.onLoad=e,this.onProgress=t,this.onError=i,this._abortController=null,this.itemStart=function(h){l++,a===!1&&n.onStart!==void 0&&n.onStart(h,o,l),a=!0},this.itemEnd=function(h){o++,n.onProgress!==void 0&&n.onProgress(h,o,l),o===l&&(a=!1,n.onLoad!==void 0&&n.onLoad())},this.itemError=function(h){n.onError!==void 0&&n.onError(h)},this.resolveURL=function(h){return s?s(h):h},this.setURLModifier=function(h){return s=h,this},this.addHandler=function(h,u){return c.push(h,u),this},this.removeHandler=function(h){let u=c.indexOf(h);return u!==-1&&c.splice(u,2),this},this.getHandler=function(h){for(let u=0,f=c.length;u<f;u+=2){let p=c[u],g=c[u+1];if(p.global&&(p.lastIndex=0),p.test(h))return g}return null},this.abort=function(){return this.abortController.abort(),this._abortController=null,this}}get abortController(){return this._abortController||(this._abortController=new AbortController),this._abortController}},Jd=new ro,so=class{constructor(e){this.manager=e!==void 0?e:Jd,this.crossOrigin="anonymous",this.withCredentials=!1,this.path="",this.resourcePath="",this.requestHeader={},typeof __THREE_DEVTOOLS__<"u"&&__THREE_DEVTOOLS__.dispatchEvent(new CustomEvent("observe",{detail:this}))}load(){}loadAsync(e,t){let i=this;return new Promise(function(n,s){i.load(e,n,t,s)})}parse(){}setCrossOrigin(e){return this.crossOrigin=e,this}setWithCredentials(e){return this.withCredentials=e,this}setPath(e){return this.path=e,this}setResourcePath(e){return this.resourcePath=e,this}setRequestHeader(e){return this.requestHeader=e,this}abort(){return this}};so.DEFAULT_MATERIAL_NAME="__DEFAULT";var py=new De,fy=new A,my=new A;var ua=new A,da=new ni,bi=new A,sn=class extends ii{constructor(){super(),this.isCamera=!0,this.type="Camera",this.matrixWorldInverse=new De,this.projectionMatrix=new De,this.projectionMatrixInverse=new De,this.coordinateSystem=zi,this._reversedDepth=!1}get reversedDepth(){return this._reversedDepth}copy(e,t){return super.copy(e,t),this.matrixWorldInverse.copy(e.matrixWorldInverse),this.projectionMatrix.copy(e.projectionMatrix),this.projectionMatrixInverse.copy(e.projectionMatrixInverse),this.coordinateSystem=e.coordinateSystem,this}getWorldDirection(e){return super.getWorldDirection(e).negate()}updateMatrixWorld(e){super.updateMatrixWorld(e),this.matrixWorld.decompose(ua,da,bi),bi.x===1&&bi.y===1&&bi.z===1?this.matrixWorldInverse.copy(this.matrixWorld).invert():this.matrixWorldInverse.compose(ua,da,bi.set(1,1,1)).invert()}updateWorldMatrix(e,t){super.updateWorldMatrix(e,t),this.matrixWorld.decompose(ua,da,bi),bi.x===1&&bi.y===1&&bi.z===1?this.matrixWorldInverse.copy(this.matrixWorld).invert():this.matrixWorldInverse.compose(ua,da,bi.set(1,1,1)).invert()}clone(){return new this.constructor().copy(this)}},Ji=new A,sd=new ne,ad=new ne,Ht=class extends sn{constructor(e=50,t=1,i=.1,n=2e3){super(),this.isPerspectiveCamera=!0,this.type="PerspectiveCamera",this.fov=e,this.zoom=1,this.near=i,this.far=n,this.focus=10,this.aspect=t,this.view=null,this.filmGauge=35,this.filmOffset=0,this.updateProjectionMatrix()}copy(e,t){return super.copy(e,t),this.fov=e.fov,this.zoom=e.zoom,this.near=e.near,this.far=e.far,this.focus=e.focus,this.aspect=e.aspect,this.view=e.view===null?null:Object.assign({},e.view),this.filmGauge=e.filmGauge,this.filmOffset=e.filmOffset,this}setFocalLength(e){let t=.5*this.getFilmHeight()/e;this.fov=2*xa*Math.atan(t),this.updateProjectionMatrix()}getFocalLength(){let e=Math.tan(.5*fa*this.fov);return .5*this.getFilmHeight()/e}getEffectiveFOV(){return 2*xa*Math.atan(Math.tan(.5*fa*this.fov)/this.zoom)}getFilmWidth(){return this.filmGauge*Math.min(this.aspect,1)}getFilmHeight(){return this.filmGauge/Math.max(this.aspect,1)}getViewBounds(e,t,i){Ji.set(-1,-1,.5).applyMatrix4(this.projectionMatrixInverse),t.set(Ji.x,Ji.y).multiplyScalar(-e/Ji.z),Ji.set(1,1,.5).applyMatrix4(this.projectionMatrixInverse),i.set(Ji.x,Ji.y).multiplyScalar(-e/Ji.z)}getViewSize(e,t){return this.getViewBounds(e,sd,ad),t.subVectors(ad,sd)}setViewOffset(e,t,i,n,s,a){this.aspect=e/t,this.view===null&&(this.view={enabled:!0,fullWidth:1,fullHeight:1,offsetX:0,offsetY:0,width:1,height:1}),this.view.enabled=!0,this.view.fullWidth=e,this.view.fullHeight=t,this.view.offsetX=i,this.view.offsetY=n,this.view.width=s,this.view.height=a,this.updateProjectionMatrix()}clearViewOffset(){this.view!==null&&(this.view.enabled=!1),this.updateProjectionMatrix()}updateProjectionMatrix(){let e=this.near,t=e*Math.tan(.5*fa*this.fov)/this.zoom,i=2*t,n=this.aspect*i,s=-.5*n,a=this.view;if(this.view!==null&&this.view.enabled){let l=a.fullWidth,c=a.fullHeight;s+=a.offsetX*n/l,t-=a.offsetY*i/c,n*=a.width/l,i*=a.height/c}let o=this.filmOffset;o!==0&&(s+=e*o/this.getFilmWidth()),this.projectionMatrix.makePerspective(s,s+n,t,t-i,e,this.far,this.coordinateSystem,this.reversedDepth),this.projectionMatrixInverse.copy(this.projectionMatrix).invert()}toJSON(e){let t=super.toJSON(e);return t.object.fov=this.fov,t.object.zoom=this.zoom,t.object.near=this.near,t.object.far=this.far,t.object.focus=this.focus,t.object.aspect=this.aspect,this.view!==null&&(t.object.view=Object.assign({},this.view)),t.object.filmGauge=this.filmGauge,t.object.filmOffset=this.filmOffset,t}};var os=class extends sn{constructor(e=-1,t=1,i=1,n=-1,s=.1,a=2e3){super(),this.isOrthographicCamera=!0,this.type="OrthographicCamera",this.zoom=1,this.view=null,this.left=e,this.right=t,this.top=i,this.bottom=n,this.near=s,this.far=a,this.updateProjectionMatrix()}copy(e,t){return super.copy(e,t),this.left=e.left,this.right=e.right,this.top=e.top,this.bottom=e.bottom,this.near=e.near,this.far=e.far,this.zoom=e.zoom,this.view=e.view===null?null:Object.assign({},e.view),this}setViewOffset(e,t,i,n,s,a){this.view===null&&(this.view={enabled:!0,fullWidth:1,fullHeight:1,offsetX:0,offsetY:0,width:1,height:1}),this.view.enabled=!0,this.view.fullWidth=e,this.view.fullHeight=t,this.view.offsetX=i,this.view.offsetY=n,this.view.width=s,this.view.height=a,this.updateProjectionMatrix()}clearViewOffset(){this.view!==null&&(this.view.enabled=!1),this.updateProjectionMatrix()}updateProjectionMatrix(){let e=(this.right-this.left)/(2*this.zoom),t=(this.top-this.bottom)/(2*this.zoom),i=(this.right+this.left)/2,n=(this.top+this.bottom)/2,s=i-e,a=i+e,o=n+t,l=n-t;if(this.view!==null&&this.view.enabled){let c=(this.right-this.left)/this.view.fullWidth/this.zoom,h=(this.top-this.bottom)/this.view.fullHeight/this.zoom;s+=c*this.view.offsetX,a=s+c*this.view.width,o-=h*this.view.offsetY,l=o-h*this.view.height}this.projectionMatrix.makeOrthographic(s,a,o,l,this.near,this.far,this.coordinateSystem,this.reversedDepth),this.projectionMatrixInverse.copy(this.projectionMatrix).invert()}toJSON(e){let t=super.toJSON(e);return t.object.zoom=this.zoom,t.object.left=this.left,t.object.right=this.right,t.object.top=this.top,t.object.bottom=this.bottom,t.object.near=this.near,t.object.far=this.far,this.view!==null&&(t.object.view=Object.assign({},this.view)),t}};var gy=new De,vy=new De,_y=new De;var tr=-90,ao=class extends ii{constructor(e,t,i){super(),this.type="CubeCamera",this.renderTarget=i,this.coordinateSystem=null,this.activeMipmapLevel=0;let n=new Ht(tr,1,e,t);n.layers=this.layers,this.add(n);let s=new Ht(tr,1,e,t);s.layers=this.layers,this.add(s);let a=new Ht(tr,1,e,t);a.layers=this.layers,this.add(a);let o=new Ht(tr,1,e,t);o.layers=this.layers,this.add(o);let l=new Ht(tr,1,e,t);l.layers=this.layers,this.add(l);let c=new Ht(tr,1,e,t);c.layers=this.layers,this.add(c)}updateCoordinateSystem(){let e=this.coordinateSystem,t=this.children.concat(),[i,n,s,a,o,l]=t;for(let c of t)this.remove(c);if(e===zi)i.up.set(0,1,0),i.lookAt(1,0,0),n.up.set(0,1,0),n.lookAt(-1,0,0),s.up.set(0,0,-1),s.lookAt(0,1,0),a.up.set(0,0,1),a.lookAt(0,-1,0),o.up.set(0,1,0),o.lookAt(0,0,1),l.up.set(0,1,0),l.lookAt(0,0,-1);else{if(e!==zr)throw new Error("THREE.CubeCamera.updateCoordinateSystem(): Invalid coordinate system: "+e);i.up.set(0,-1,0),i.lookAt(-1,0,0),n.up.set(0,-1,0),n.lookAt(1,0,0),s.up.set(0,0,1),s.lookAt(0,1,0),a.up.set(0,0,-1),a.lookAt(0,-1,0),o.up.set(0,-1,0),o.lookAt(0,0,1),l.up.set(0,-1,0),l.lookAt(0,0,-1)}for(let c of t)this.add(c),c.updateMatrixWorld()}update(e,t){this.parent===null&&this.updateMatrixWorld();let{renderTarget:i,activeMipmapLevel:n}=this;this.coordinateSystem!==e.coordinateSystem&&(this.coordinateSystem=e.coordinateSystem,this.updateCoordinateSystem());let[s,a,o,l,c,h]=this.children,u=e.getRenderTarget(),f=e.getActiveCubeFace(),p=e.getActiveMipmapLevel(),g=e.xr.enabled;e.xr.enabled=!1;let d=i.texture.generateMipmaps;i.texture.generateMipmaps=!1;let _=!1;_=e.isWebGLRenderer===!0?e.state.buffers.depth.getReversed():e.reversedDepthBuffer,e.setRenderTarget(i,0,n),_&&e.autoClear===!1&&e.clearDepth(),e.render(t,s),e.setRenderTarget(i,1,n),_&&e.autoClear===!1&&e.clearDepth(),e.render(t,a),e.setRenderTarget(i,2,n),_&&e.autoClear===!1&&e.clearDepth(),e.render(t,o),e.setRenderTarget(i,3,n),_&&e.autoClear===!1&&e.clearDepth(),e.render(t,l),e.setRenderTarget(i,4,n),_&&e.autoClear===!1&&e.clearDepth(),e.render(t,c),i.texture.generateMipmaps=d,e.setRenderTarget(i,5,n),_&&e.autoClear===!1&&e.clearDepth(),e.render(t,h),e.setRenderTarget(u,f,p),e.xr.enabled=g,i.texture.needsPMREMUpdate=!0}},oo=class extends Ht{constructor(e=[]){super(),this.isArrayCamera=!0,this.isMultiViewCamera=!1,this.cameras=e}};var xy=new A,yy=new ni,My=new A,Sy=new A,by=new A;var wy=new A,Ty=new ni,Ey=new A,Ay=new A;var rh="\\[\\]\\.:\\/",Km=new RegExp("["+rh+"]","g"),Gl="[^"+rh+"]",$m="[^"+rh.replace("\\.","")+"]",Jm=new RegExp("^"+/((?:WC+[\/:])*)/.source.replace("WC",Gl)+/(WCOD+)?/.source.replace("WCOD",$m)+/(?:\.(WC+)(?:\[(.+)\])?)?/.source.replace("WC",Gl)+/\.(WC+)(?:\[(.+)\])?/.source.replace("WC",Gl)+"$"),Qm=["material","materials","bones","map"],it=class r{constructor(e,t,i){this.path=t,this.parsedPath=i||r.parseTrackName(t),this.node=r.findNode(e,this.parsedPath.nodeName),this.rootNode=e,this.getValue=this._getValue_unbound,this.setValue=this._setValue_unbound}static create(e,t,i){return e&&e.isAnimationObjectGroup?new r.Composite(e,t,i):new r(e,t,i)}static sanitizeNodeName(e){return e.replace(/\s/g,"_").replace(Km,"")}static parseTrackName(e){let t=Jm.exec(e);if(t===null)throw new Error("PropertyBinding: Cannot parse trackName: "+e);let i={nodeName:t[2],objectName:t[3],objectIndex:t[4],propertyName:t[5],propertyIndex:t[6]},n=i.nodeName&&i.nodeName.lastIndexOf(".");if(n!==void 0&&n!==-1){let s=i.nodeName.substring(n+1);Qm.indexOf(s)!==-1&&(i.nodeName=i.nodeName.substring(0,n),i.objectName=s)}if(i.propertyName===null||i.propertyName.length===0)throw new Error("PropertyBinding: can not parse propertyName from trackName: "+e);return i}static findNode(e,t){if(t===void 0||t===""||t==="."||t===-1||t===e.name||t===e.uuid)return e;if(e.skeleton){let i=e.skeleton.getBoneByName(t);if(i!==void 0)return i}if(e.children){let i=function(s){for(let a=0;a<s.length;a++){let o=s[a];if(o.name===t||o.uuid===t)return o;let l=i(o.children);if(l)return l}return null},n=i(e.children);if(n)return n}return null}_getValue_unavailable(){}_setValue_unavailable(){}_getValue_direct(e,t){e[t]=this.targetObject[this.propertyName]}_getValue_array(e,t){let i=this.resolvedProperty;for(let n=0,s=i.length;n!==s;++n)e[t++]=i[n]}_getValue_arrayElement(e,t){e[t]=this.resolvedProperty[this.propertyIndex]}_getValue_toArray(e,t){this.resolvedProperty.toArray(e,t)}_setValue_direct(e,t){this.targetObject[this.propertyName]=e[t]}_setValue_direct_setNeedsUpdate(e,t){this.targetObject[this.propertyName]=e[t],this.targetObject.needsUpdate=!0}_setValue_direct_setMatrixWorldNeedsUpdate(e,t){this.targetObject[this.propertyName]=e[t],this.targetObject.matrixWorldNeedsUpdate=!0}_setValue_array(e,t){let i=this.resolvedProperty;for(let n=0,s=i.length;n!==s;++n)i[n]=e[t++]}_setValue_array_setNeedsUpdate(e,t){let i=this.resolvedProperty;for(let n=0,s=i.length;n!==s;++n)i[n]=e[t++];this.targetObject.needsUpdate=!0}_setValue_array_setMatrixWorldNeedsUpdate(e,t){let i=this.resolvedProperty;for(let n=0,s=i.length;n!==s;++n)i[n]=e[t++];this.targetObject.matrixWorldNeedsUpdate=!0}_setValue_arrayElement(e,t){this.resolvedProperty[this.propertyIndex]=e[t]}_setValue_arrayElement_setNeedsUpdate(e,t){this.resolvedProperty[this.propertyIndex]=e[t],this.targetObject.needsUpdate=!0}_setValue_arrayElement_setMatrixWorldNeedsUpdate(e,t){this.resolvedProperty[this.propertyIndex]=e[t],this.targetObject.matrixWorldNeedsUpdate=!0}_setValue_fromArray(e,t){this.resolvedProperty.fromArray(e,t)}_setValue_fromArray_setNeedsUpdate(e,t){this.resolvedProperty.fromArray(e,t),this.targetObject.needsUpdate=!0}_setValue_fromArray_setMatrixWorldNeedsUpdate(e,t){this.resolvedProperty.fromArray(e,t),this.targetObject.matrixWorldNeedsUpdate=!0}_getValue_unbound(e,t){this.bind(),this.getValue(e,t)}_setValue_unbound(e,t){this.bind(),this.setValue(e,t)}bind(){let e=this.node,t=this.parsedPath,i=t.objectName,n=t.propertyName,s=t.propertyIndex;if(e||(e=r.findNode(this.rootNode,t.nodeName),this.node=e),this.getValue=this._getValue_unavailable,this.setValue=this._setValue_unavailable,!e)return void we("PropertyBinding: No target node found for track: "+this.path+".");if(i){let c=t.objectIndex;switch(i){case"materials":if(!e.material)return void Te("PropertyBinding: Can not bind to material as node does not have a material.",this);if(!e.material.materials)return void Te("PropertyBinding: Can not bind to material.materials as node.material does not have a materials array.",this);e=e.material.materials;break;case"bones":if(!e.skeleton)return void Te("PropertyBinding: Can not bind to bones as node does not have a skeleton.",this);e=e.skeleton.bones;for(let h=0;h<e.length;h++)if(e[h].name===c){c=h;break}break;case"map":if("map"in e){e=e.map;break}if(!e.material)return void Te("PropertyBinding: Can not bind to material as node does not have a material.",this);if(!e.material.map)return void Te("PropertyBinding: Can not bind to material.map as node.material does not have a map.",this);e=e.material.map;break;default:if(e[i]===void 0)return void Te("PropertyBinding: Can not bind to objectName of node undefined.",this);e=e[i]}if(c!==void 0){if(e[c]===void 0)return void Te("PropertyBinding: Trying to bind to objectIndex of objectName, but is undefined.",this,e);e=e[c]}}let a=e[n];if(a===void 0)return void Te("PropertyBinding: Trying to update property for track: "+t.nodeName+"."+n+" but it wasn't found.",e);let o=this.Versioning.None;this.targetObject=e,e.isMaterial===!0?o=this.Versioning.NeedsUpdate:e.isObject3D===!0&&(o=this.Versioning.MatrixWorldNeedsUpdate);let l=this.BindingType.Direct;if(s!==void 0){if(n==="morphTargetInfluences"){if(!e.geometry)return void Te("PropertyBinding: Can not bind to morphTargetInfluences because node does not have a geometry.",this);if(!e.geometry.morphAttributes)return void Te("PropertyBinding: Can not bind to morphTargetInfluences because node does not have a geometry.morphAttributes.",this);e.morphTargetDictionary[s]!==void 0&&(s=e.morphTargetDictionary[s])}l=this.BindingType.ArrayElement,this.resolvedProperty=a,this.propertyIndex=s}else a.fromArray!==void 0&&a.toArray!==void 0?(l=this.BindingType.HasFromToArray,this.resolvedProperty=a):Array.isArray(a)?(l=this.BindingType.EntireArray,this.resolvedProperty=a):this.propertyName=n;this.getValue=this.GetterByBindingType[l],this.setValue=this.SetterByBindingTypeAndVersioning[l][o]}unbind(){this.node=null,this.getValue=this._getValue_unbound,this.setValue=this._setValue_unbound}};it.Composite=class{constructor(r,e,t){let i=t||it.parseTrackName(e);this._targetGroup=r,this._bindings=r.subscribe_(e,i)}getValue(r,e){this.bind();let t=this._targetGroup.nCachedObjects_,i=this._bindings[t];i!==void 0&&i.getValue(r,e)}setValue(r,e){let t=this._bindings;for(let i=this._targetGroup.nCachedObjects_,n=t.length;i!==n;++i)t[i].setValue(r,e)}bind(){let r=this._bindings;for(let e=this._targetGroup.nCachedObjects_,t=r.length;e!==t;++e)r[e].bind()}unbind(){let r=this._bindings;for(let e=this._targetGroup.nCachedObjects_,t=r.length;e!==t;++e)r[e].unbind()}},it.prototype.BindingType={Direct:0,EntireArray:1,ArrayElement:2,HasFromToArray:3},it.prototype.Versioning={None:0,NeedsUpdate:1,MatrixWorldNeedsUpdate:2},it.prototype.GetterByBindingType=[it.prototype._getValue_direct,it.prototype._getValue_array,it.prototype._getValue_arrayElement,it.prototype._getValue_toArray],it.prototype.SetterByBindingTypeAndVersioning=[[it.prototype._setValue_direct,it.prototype._setValue_direct_setNeedsUpdate,it.prototype._setValue_direct_setMatrixWorldNeedsUpdate],[it.prototype._setValue_array,it.prototype._setValue_array_setNeedsUpdate,it.prototype._setValue_array_setMatrixWorldNeedsUpdate],[it.prototype._setValue_arrayElement,it.prototype._setValue_arrayElement_setNeedsUpdate,it.prototype._setValue_arrayElement_setMatrixWorldNeedsUpdate],[it.prototype._setValue_fromArray,it.prototype._setValue_fromArray_setNeedsUpdate,it.prototype._setValue_fromArray_setMatrixWorldNeedsUpdate]];var Cy=new Float32Array(1);var Ry=new De;var $l=class r{static{r.prototype.isMatrix2=!0}constructor(e,t,i,n){this.elements=[1,0,0,1],e!==void 0&&this.set(e,t,i,n)}identity(){return this.set(1,0,0,1),this}fromArray(e,t=0){for(let i=0;i<4;i++)this.elements[i]=e[i+t];return this}set(e,t,i,n){let s=this.elements;return s[0]=e,s[2]=t,s[1]=i,s[3]=n,this}},Iy=new ne;var Py=new A,Ly=new A,Uy=new A,Dy=new A,Ny=new A,Fy=new A,Oy=new A;var By=new A;var ky=new A,zy=new De,Gy=new De;var Vy=new A,Hy=new je,Wy=new je;var Xy=new A,jy=new A,qy=new A;var Yy=new A,Zy=new sn;var Ky=new pi;var $y=new A;function sh(r,e,t,i){let n=(function(s){switch(s){case zt:case vc:return{byteLength:1,components:1};case an:case _c:case Ci:return{byteLength:2,components:1};case fo:case mo:return{byteLength:2,components:4};case Vi:case po:case gi:return{byteLength:4,components:1};case xc:case yc:return{byteLength:4,components:3}}throw new Error(`Unknown texture type ${s}.`)})(i);switch(t){case 1021:return r*e;case Mc:case In:return r*e/n.components*n.byteLength;case 1030:case 1031:return r*e*2/n.components*n.byteLength;case 1022:return r*e*3/n.components*n.byteLength;case Jt:case 1033:return r*e*4/n.components*n.byteLength;case 33776:case 33777:return Math.floor((r+3)/4)*Math.floor((e+3)/4)*8;case 33778:case 33779:return Math.floor((r+3)/4)*Math.floor((e+3)/4)*16;case 35841:case 35843:return Math.max(r,16)*Math.max(e,8)/4;case 35840:case 35842:return Math.max(r,8)*Math.max(e,8)/2;case 36196:case 37492:case 37488:case 37489:return Math.floor((r+3)/4)*Math.floor((e+3)/4)*8;case 37496:case 37490:case 37491:case 37808:return Math.floor((r+3)/4)*Math.floor((e+3)/4)*16;case 37809:return Math.floor((r+4)/5)*Math.floor((e+3)/4)*16;case 37810:return Math.floor((r+4)/5)*Math.floor((e+4)/5)*16;case 37811:return Math.floor((r+5)/6)*Math.floor((e+4)/5)*16;case 37812:return Math.floor((r+5)/6)*Math.floor((e+5)/6)*16;case 37813:return Math.floor((r+7)/8)*Math.floor((e+4)/5)*16;case 37814:return Math.floor((r+7)/8)*Math.floor((e+5)/6)*16;case 37815:return Math.floor((r+7)/8)*Math.floor((e+7)/8)*16;case 37816:return Math.floor((r+9)/10)*Math.floor((e+4)/5)*16;case 37817:return Math.floor((r+9)/10)*Math.floor((e+5)/6)*16;case 37818:return Math.floor((r+9)/10)*Math.floor((e+7)/8)*16;case 37819:return Math.floor((r+9)/10)*Math.floor((e+9)/10)*16;case 37820:return Math.floor((r+11)/12)*Math.floor((e+9)/10)*16;case 37821:return Math.floor((r+11)/12)*Math.floor((e+11)/12)*16;case 36492:case 36494:case 36495:return Math.ceil(r/4)*Math.ceil(e/4)*16;case 36283:case 36284:return Math.ceil(r/4)*Math.ceil(e/4)*8;case 36285:case 36286:return Math.ceil(r/4)*Math.ceil(e/4)*16}throw new Error(`Unable to determine texture byte length for ${t} format.`)}typeof __THREE_DEVTOOLS__<"u"&&__THREE_DEVTOOLS__.dispatchEvent(new CustomEvent("register",{detail:{revision:"184"}})),typeof window<"u"&&(window.__THREE__?we("WARNING: Multiple instances of Three.js being imported."):window.__THREE__="184");function Mp(){let r=null,e=!1,t=null,i=null;function n(s,a){t(s,a),i=r.requestAnimationFrame(n)}return{start:function(){e!==!0&&t!==null&&r!==null&&(i=r.requestAnimationFrame(n),e=!0)},stop:function(){r!==null&&r.cancelAnimationFrame(i),e=!1},setAnimationLoop:function(s){t=s},setContext:function(s){r=s}}}function tg(r){let e=new WeakMap;return{get:function(t){return t.isInterleavedBufferAttribute&&(t=t.data),e.get(t)},remove:function(t){t.isInterleavedBufferAttribute&&(t=t.data);let i=e.get(t);i&&(r.deleteBuffer(i.buffer),e.delete(t))},update:function(t,i){if(t.isInterleavedBufferAttribute&&(t=t.data),t.isGLBufferAttribute){let s=e.get(t);return void((!s||s.version<t.version)&&e.set(t,{buffer:t.buffer,type:t.type,bytesPerElement:t.elementSize,version:t.version}))}let n=e.get(t);if(n===void 0)e.set(t,(function(s,a){let o=s.array,l=s.usage,c=o.byteLength,h=r.createBuffer(),u;if(r.bindBuffer(a,h),r.bufferData(a,o,l),s.onUploadCallback(),o instanceof Float32Array)u=r.FLOAT;else if(typeof Float16Array<"u"&&o instanceof Float16Array)u=r.HALF_FLOAT;else if(o instanceof Uint16Array)u=s.isFloat16BufferAttribute?r.HALF_FLOAT:r.UNSIGNED_SHORT;else if(o instanceof Int16Array)u=r.SHORT;else if(o instanceof Uint32Array)u=r.UNSIGNED_INT;else if(o instanceof Int32Array)u=r.INT;else if(o instanceof Int8Array)u=r.BYTE;else if(o instanceof Uint8Array)u=r.UNSIGNED_BYTE;else{if(!(o instanceof Uint8ClampedArray))throw new Error("THREE.WebGLAttributes: Unsupported buffer data format: "+o);u=r.UNSIGNED_BYTE}return{buffer:h,type:u,bytesPerElement:o.BYTES_PER_ELEMENT,version:s.version,size:c}})(t,i));else if(n.version<t.version){if(n.size!==t.array.byteLength)throw new Error("THREE.WebGLAttributes: The size of the buffer attribute's array buffer does not match the original size. Resizing buffer attributes is not supported.");(function(s,a,o){let l=a.array,c=a.updateRanges;if(r.bindBuffer(o,s),c.length===0)r.bufferSubData(o,0,l);else{c.sort((u,f)=>u.start-f.start);let h=0;for(let u=1;u<c.length;u++){let f=c[h],p=c[u];p.start<=f.start+f.count+1?f.count=Math.max(f.count,p.start+p.count-f.start):(++h,c[h]=p)}c.length=h+1;for(let u=0,f=c.length;u<f;u++){let p=c[u];r.bufferSubData(o,p.start*l.BYTES_PER_ELEMENT,l,p.start,p.count)}a.clearUpdateRanges()}a.onUploadCallback()})(n.buffer,t,i),n.version=t.version}}}}var Ne={alphahash_fragment:`#ifdef USE_ALPHAHASH
	if ( diffuseColor.a < getAlphaHashThreshold( vPosition ) ) discard;
#endif`,alphahash_pars_fragment:`#ifdef USE_ALPHAHASH
	const float ALPHA_HASH_SCALE = 0.05;
	float hash2D( vec2 value ) {
		return fract( 1.0e4 * sin( 17.0 * value.x + 0.1 * value.y ) * ( 0.1 + abs( sin( 13.0 * value.y + value.x ) ) ) );
	}
	float hash3D( vec3 value ) {
		return hash2D( vec2( hash2D( value.xy ), value.z ) );
	}
	float getAlphaHashThreshold( vec3 position ) {
		float maxDeriv = max(
			length( dFdx( position.xyz ) ),
			length( dFdy( position.xyz ) )
		);
		float pixScale = 1.0 / ( ALPHA_HASH_SCALE * maxDeriv );
		vec2 pixScales = vec2(
			exp2( floor( log2( pixScale ) ) ),
			exp2( ceil( log2( pixScale ) ) )
		);
		vec2 alpha = vec2(
			hash3D( floor( pixScales.x * position.xyz ) ),
			hash3D( floor( pixScales.y * position.xyz ) )
		);
		float lerpFactor = fract( log2( pixScale ) );
		float x = ( 1.0 - lerpFactor ) * alpha.x + lerpFactor * alpha.y;
		float a = min( lerpFactor, 1.0 - lerpFactor );
		vec3 cases = vec3(
			x * x / ( 2.0 * a * ( 1.0 - a ) ),
			( x - 0.5 * a ) / ( 1.0 - a ),
			1.0 - ( ( 1.0 - x ) * ( 1.0 - x ) / ( 2.0 * a * ( 1.0 - a ) ) )
		);
		float threshold = ( x < ( 1.0 - a ) )
			? ( ( x < a ) ? cases.x : cases.y )
			: cases.z;
		return clamp( threshold , 1.0e-6, 1.0 );
	}
#endif`,alphamap_fragment:`#ifdef USE_ALPHAMAP
	diffuseColor.a *= texture2D( alphaMap, vAlphaMapUv ).g;
#endif`,alphamap_pars_fragment:`#ifdef USE_ALPHAMAP
	uniform sampler2D alphaMap;
#endif`,alphatest_fragment:`#ifdef USE_ALPHATEST
	#ifdef ALPHA_TO_COVERAGE
	diffuseColor.a = smoothstep( alphaTest, alphaTest + fwidth( diffuseColor.a ), diffuseColor.a );
	if ( diffuseColor.a == 0.0 ) discard;
	#else
	if ( diffuseColor.a < alphaTest ) discard;
	#endif
#endif`,alphatest_pars_fragment:`#ifdef USE_ALPHATEST
	uniform float alphaTest;
#endif`,aomap_fragment:`#ifdef USE_AOMAP
	float ambientOcclusion = ( texture2D( aoMap, vAoMapUv ).r - 1.0 ) * aoMapIntensity + 1.0;
	reflectedLight.indirectDiffuse *= ambientOcclusion;
	#if defined( USE_CLEARCOAT ) 
		clearcoatSpecularIndirect *= ambientOcclusion;
	#endif
	#if defined( USE_SHEEN ) 
		sheenSpecularIndirect *= ambientOcclusion;
	#endif
	#if defined( USE_ENVMAP ) && defined( STANDARD )
		float dotNV = saturate( dot( geometryNormal, geometryViewDir ) );
		reflectedLight.indirectSpecular *= computeSpecularOcclusion( dotNV, ambientOcclusion, material.roughness );
	#endif
#endif`,aomap_pars_fragment:`#ifdef USE_AOMAP
	uniform sampler2D aoMap;
	uniform float aoMapIntensity;
#endif`,batching_pars_vertex:`#ifdef USE_BATCHING
	#if ! defined( GL_ANGLE_multi_draw )
	#define gl_DrawID _gl_DrawID
	uniform int _gl_DrawID;
	#endif
	uniform highp sampler2D batchingTexture;
	uniform highp usampler2D batchingIdTexture;
	mat4 getBatchingMatrix( const in float i ) {
		int size = textureSize( batchingTexture, 0 ).x;
		int j = int( i ) * 4;
		int x = j % size;
		int y = j / size;
		vec4 v1 = texelFetch( batchingTexture, ivec2( x, y ), 0 );
		vec4 v2 = texelFetch( batchingTexture, ivec2( x + 1, y ), 0 );
		vec4 v3 = texelFetch( batchingTexture, ivec2( x + 2, y ), 0 );
		vec4 v4 = texelFetch( batchingTexture, ivec2( x + 3, y ), 0 );
		return mat4( v1, v2, v3, v4 );
	}
	float getIndirectIndex( const in int i ) {
		int size = textureSize( batchingIdTexture, 0 ).x;
		int x = i % size;
		int y = i / size;
		return float( texelFetch( batchingIdTexture, ivec2( x, y ), 0 ).r );
	}
#endif
#ifdef USE_BATCHING_COLOR
	uniform sampler2D batchingColorTexture;
	vec4 getBatchingColor( const in float i ) {
		int size = textureSize( batchingColorTexture, 0 ).x;
		int j = int( i );
		int x = j % size;
		int y = j / size;
		return texelFetch( batchingColorTexture, ivec2( x, y ), 0 );
	}
#endif`,batching_vertex:`#ifdef USE_BATCHING
	mat4 batchingMatrix = getBatchingMatrix( getIndirectIndex( gl_DrawID ) );
#endif`,begin_vertex:`vec3 transformed = vec3( position );
#ifdef USE_ALPHAHASH
	vPosition = vec3( position );
#endif`,beginnormal_vertex:`vec3 objectNormal = vec3( normal );
#ifdef USE_TANGENT
	vec3 objectTangent = vec3( tangent.xyz );
#endif`,bsdfs:`float G_BlinnPhong_Implicit( ) {
	return 0.25;
}
float D_BlinnPhong( const in float shininess, const in float dotNH ) {
	return RECIPROCAL_PI * ( shininess * 0.5 + 1.0 ) * pow( dotNH, shininess );
}
vec3 BRDF_BlinnPhong( const in vec3 lightDir, const in vec3 viewDir, const in vec3 normal, const in vec3 specularColor, const in float shininess ) {
	vec3 halfDir = normalize( lightDir + viewDir );
	float dotNH = saturate( dot( normal, halfDir ) );
	float dotVH = saturate( dot( viewDir, halfDir ) );
	vec3 F = F_Schlick( specularColor, 1.0, dotVH );
	float G = G_BlinnPhong_Implicit( );
	float D = D_BlinnPhong( shininess, dotNH );
	return F * ( G * D );
} // validated`,iridescence_fragment:`#ifdef USE_IRIDESCENCE
	const mat3 XYZ_TO_REC709 = mat3(
		 3.2404542, -0.9692660,  0.0556434,
		-1.5371385,  1.8760108, -0.2040259,
		-0.4985314,  0.0415560,  1.0572252
	);
	vec3 Fresnel0ToIor( vec3 fresnel0 ) {
		vec3 sqrtF0 = sqrt( fresnel0 );
		return ( vec3( 1.0 ) + sqrtF0 ) / ( vec3( 1.0 ) - sqrtF0 );
	}
	vec3 IorToFresnel0( vec3 transmittedIor, float incidentIor ) {
		return pow2( ( transmittedIor - vec3( incidentIor ) ) / ( transmittedIor + vec3( incidentIor ) ) );
	}
	float IorToFresnel0( float transmittedIor, float incidentIor ) {
		return pow2( ( transmittedIor - incidentIor ) / ( transmittedIor + incidentIor ));
	}
	vec3 evalSensitivity( float OPD, vec3 shift ) {
		float phase = 2.0 * PI * OPD * 1.0e-9;
		vec3 val = vec3( 5.4856e-13, 4.4201e-13, 5.2481e-13 );
		vec3 pos = vec3( 1.6810e+06, 1.7953e+06, 2.2084e+06 );
		vec3 var = vec3( 4.3278e+09, 9.3046e+09, 6.6121e+09 );
		vec3 xyz = val * sqrt( 2.0 * PI * var ) * cos( pos * phase + shift ) * exp( - pow2( phase ) * var );
		xyz.x += 9.7470e-14 * sqrt( 2.0 * PI * 4.5282e+09 ) * cos( 2.2399e+06 * phase + shift[ 0 ] ) * exp( - 4.5282e+09 * pow2( phase ) );
		xyz /= 1.0685e-7;
		vec3 rgb = XYZ_TO_REC709 * xyz;
		return rgb;
	}
	vec3 evalIridescence( float outsideIOR, float eta2, float cosTheta1, float thinFilmThickness, vec3 baseF0 ) {
		vec3 I;
		float iridescenceIOR = mix( outsideIOR, eta2, smoothstep( 0.0, 0.03, thinFilmThickness ) );
		float sinTheta2Sq = pow2( outsideIOR / iridescenceIOR ) * ( 1.0 - pow2( cosTheta1 ) );
		float cosTheta2Sq = 1.0 - sinTheta2Sq;
		if ( cosTheta2Sq < 0.0 ) {
			return vec3( 1.0 );
		}
		float cosTheta2 = sqrt( cosTheta2Sq );
		float R0 = IorToFresnel0( iridescenceIOR, outsideIOR );
		float R12 = F_Schlick( R0, 1.0, cosTheta1 );
		float T121 = 1.0 - R12;
		float phi12 = 0.0;
		if ( iridescenceIOR < outsideIOR ) phi12 = PI;
		float phi21 = PI - phi12;
		vec3 baseIOR = Fresnel0ToIor( clamp( baseF0, 0.0, 0.9999 ) );		vec3 R1 = IorToFresnel0( baseIOR, iridescenceIOR );
		vec3 R23 = F_Schlick( R1, 1.0, cosTheta2 );
		vec3 phi23 = vec3( 0.0 );
		if ( baseIOR[ 0 ] < iridescenceIOR ) phi23[ 0 ] = PI;
		if ( baseIOR[ 1 ] < iridescenceIOR ) phi23[ 1 ] = PI;
		if ( baseIOR[ 2 ] < iridescenceIOR ) phi23[ 2 ] = PI;
		float OPD = 2.0 * iridescenceIOR * thinFilmThickness * cosTheta2;
		vec3 phi = vec3( phi21 ) + phi23;
		vec3 R123 = clamp( R12 * R23, 1e-5, 0.9999 );
		vec3 r123 = sqrt( R123 );
		vec3 Rs = pow2( T121 ) * R23 / ( vec3( 1.0 ) - R123 );
		vec3 C0 = R12 + Rs;
		I = C0;
		vec3 Cm = Rs - T121;
		for ( int m = 1; m <= 2; ++ m ) {
			Cm *= r123;
			vec3 Sm = 2.0 * evalSensitivity( float( m ) * OPD, float( m ) * phi );
			I += Cm * Sm;
		}
		return max( I, vec3( 0.0 ) );
	}
#endif`,bumpmap_pars_fragment:`#ifdef USE_BUMPMAP
	uniform sampler2D bumpMap;
	uniform float bumpScale;
	vec2 dHdxy_fwd() {
		vec2 dSTdx = dFdx( vBumpMapUv );
		vec2 dSTdy = dFdy( vBumpMapUv );
		float Hll = bumpScale * texture2D( bumpMap, vBumpMapUv ).x;
		float dBx = bumpScale * texture2D( bumpMap, vBumpMapUv + dSTdx ).x - Hll;
		float dBy = bumpScale * texture2D( bumpMap, vBumpMapUv + dSTdy ).x - Hll;
		return vec2( dBx, dBy );
	}
	vec3 perturbNormalArb( vec3 surf_pos, vec3 surf_norm, vec2 dHdxy, float faceDirection ) {
		vec3 vSigmaX = normalize( dFdx( surf_pos.xyz ) );
		vec3 vSigmaY = normalize( dFdy( surf_pos.xyz ) );
		vec3 vN = surf_norm;
		vec3 R1 = cross( vSigmaY, vN );
		vec3 R2 = cross( vN, vSigmaX );
		float fDet = dot( vSigmaX, R1 ) * faceDirection;
		vec3 vGrad = sign( fDet ) * ( dHdxy.x * R1 + dHdxy.y * R2 );
		return normalize( abs( fDet ) * surf_norm - vGrad );
	}
#endif`,clipping_planes_fragment:`#if NUM_CLIPPING_PLANES > 0
	vec4 plane;
	#ifdef ALPHA_TO_COVERAGE
		float distanceToPlane, distanceGradient;
		float clipOpacity = 1.0;
		#pragma unroll_loop_start
		for ( int i = 0; i < UNION_CLIPPING_PLANES; i ++ ) {
			plane = clippingPlanes[ i ];
			distanceToPlane = - dot( vClipPosition, plane.xyz ) + plane.w;
			distanceGradient = fwidth( distanceToPlane ) / 2.0;
			clipOpacity *= smoothstep( - distanceGradient, distanceGradient, distanceToPlane );
			if ( clipOpacity == 0.0 ) discard;
		}
		#pragma unroll_loop_end
		#if UNION_CLIPPING_PLANES < NUM_CLIPPING_PLANES
			float unionClipOpacity = 1.0;
			#pragma unroll_loop_start
			for ( int i = UNION_CLIPPING_PLANES; i < NUM_CLIPPING_PLANES; i ++ ) {
				plane = clippingPlanes[ i ];
				distanceToPlane = - dot( vClipPosition, plane.xyz ) + plane.w;
				distanceGradient = fwidth( distanceToPlane ) / 2.0;
				unionClipOpacity *= 1.0 - smoothstep( - distanceGradient, distanceGradient, distanceToPlane );
			}
			#pragma unroll_loop_end
			clipOpacity *= 1.0 - unionClipOpacity;
		#endif
		diffuseColor.a *= clipOpacity;
		if ( diffuseColor.a == 0.0 ) discard;
	#else
		#pragma unroll_loop_start
		for ( int i = 0; i < UNION_CLIPPING_PLANES; i ++ ) {
			plane = clippingPlanes[ i ];
			if ( dot( vClipPosition, plane.xyz ) > plane.w ) discard;
		}
		#pragma unroll_loop_end
		#if UNION_CLIPPING_PLANES < NUM_CLIPPING_PLANES
			bool clipped = true;
			#pragma unroll_loop_start
			for ( int i = UNION_CLIPPING_PLANES; i < NUM_CLIPPING_PLANES; i ++ ) {
				plane = clippingPlanes[ i ];
				clipped = ( dot( vClipPosition, plane.xyz ) > plane.w ) && clipped;
			}
			#pragma unroll_loop_end
			if ( clipped ) discard;
		#endif
	#endif
#endif`,clipping_planes_pars_fragment:`#if NUM_CLIPPING_PLANES > 0
	varying vec3 vClipPosition;
	uniform vec4 clippingPlanes[ NUM_CLIPPING_PLANES ];
#endif`,clipping_planes_pars_vertex:`#if NUM_CLIPPING_PLANES > 0
	varying vec3 vClipPosition;
#endif`,clipping_planes_vertex:`#if NUM_CLIPPING_PLANES > 0
	vClipPosition = - mvPosition.xyz;
#endif`,color_fragment:`#if defined( USE_COLOR ) || defined( USE_COLOR_ALPHA )
	diffuseColor *= vColor;
#endif`,color_pars_fragment:`#if defined( USE_COLOR ) || defined( USE_COLOR_ALPHA )
	varying vec4 vColor;
#endif`,color_pars_vertex:`#if defined( USE_COLOR ) || defined( USE_COLOR_ALPHA ) || defined( USE_INSTANCING_COLOR ) || defined( USE_BATCHING_COLOR )
	varying vec4 vColor;
#endif`,color_vertex:`#if defined( USE_COLOR ) || defined( USE_COLOR_ALPHA ) || defined( USE_INSTANCING_COLOR ) || defined( USE_BATCHING_COLOR )
	vColor = vec4( 1.0 );
#endif
#ifdef USE_COLOR_ALPHA
	vColor *= color;
#elif defined( USE_COLOR )
	vColor.rgb *= color;
#endif
#ifdef USE_INSTANCING_COLOR
	vColor.rgb *= instanceColor.rgb;
#endif
#ifdef USE_BATCHING_COLOR
	vColor *= getBatchingColor( getIndirectIndex( gl_DrawID ) );
#endif`,common:`#define PI 3.141592653589793
#define PI2 6.283185307179586
#define PI_HALF 1.5707963267948966
#define RECIPROCAL_PI 0.3183098861837907
#define RECIPROCAL_PI2 0.15915494309189535
#define EPSILON 1e-6
#ifndef saturate
#define saturate( a ) clamp( a, 0.0, 1.0 )
#endif
#define whiteComplement( a ) ( 1.0 - saturate( a ) )
float pow2( const in float x ) { return x*x; }
vec3 pow2( const in vec3 x ) { return x*x; }
float pow3( const in float x ) { return x*x*x; }
float pow4( const in float x ) { float x2 = x*x; return x2*x2; }
float max3( const in vec3 v ) { return max( max( v.x, v.y ), v.z ); }
float average( const in vec3 v ) { return dot( v, vec3( 0.3333333 ) ); }
highp float rand( const in vec2 uv ) {
	const highp float a = 12.9898, b = 78.233, c = 43758.5453;
	highp float dt = dot( uv.xy, vec2( a,b ) ), sn = mod( dt, PI );
	return fract( sin( sn ) * c );
}
#ifdef HIGH_PRECISION
	float precisionSafeLength( vec3 v ) { return length( v ); }
#else
	float precisionSafeLength( vec3 v ) {
		float maxComponent = max3( abs( v ) );
		return length( v / maxComponent ) * maxComponent;
	}
#endif
struct IncidentLight {
	vec3 color;
	vec3 direction;
	bool visible;
};
struct ReflectedLight {
	vec3 directDiffuse;
	vec3 directSpecular;
	vec3 indirectDiffuse;
	vec3 indirectSpecular;
};
#ifdef USE_ALPHAHASH
	varying vec3 vPosition;
#endif
vec3 transformDirection( in vec3 dir, in mat4 matrix ) {
	return normalize( ( matrix * vec4( dir, 0.0 ) ).xyz );
}
vec3 inverseTransformDirection( in vec3 dir, in mat4 matrix ) {
	return normalize( ( vec4( dir, 0.0 ) * matrix ).xyz );
}
bool isPerspectiveMatrix( mat4 m ) {
	return m[ 2 ][ 3 ] == - 1.0;
}
vec2 equirectUv( in vec3 dir ) {
	float u = atan( dir.z, dir.x ) * RECIPROCAL_PI2 + 0.5;
	float v = asin( clamp( dir.y, - 1.0, 1.0 ) ) * RECIPROCAL_PI + 0.5;
	return vec2( u, v );
}
vec3 BRDF_Lambert( const in vec3 diffuseColor ) {
	return RECIPROCAL_PI * diffuseColor;
}
vec3 F_Schlick( const in vec3 f0, const in float f90, const in float dotVH ) {
	float fresnel = exp2( ( - 5.55473 * dotVH - 6.98316 ) * dotVH );
	return f0 * ( 1.0 - fresnel ) + ( f90 * fresnel );
}
float F_Schlick( const in float f0, const in float f90, const in float dotVH ) {
	float fresnel = exp2( ( - 5.55473 * dotVH - 6.98316 ) * dotVH );
	return f0 * ( 1.0 - fresnel ) + ( f90 * fresnel );
} // validated`,cube_uv_reflection_fragment:`#ifdef ENVMAP_TYPE_CUBE_UV
	#define cubeUV_minMipLevel 4.0
	#define cubeUV_minTileSize 16.0
	float getFace( vec3 direction ) {
		vec3 absDirection = abs( direction );
		float face = - 1.0;
		if ( absDirection.x > absDirection.z ) {
			if ( absDirection.x > absDirection.y )
				face = direction.x > 0.0 ? 0.0 : 3.0;
			else
				face = direction.y > 0.0 ? 1.0 : 4.0;
		} else {
			if ( absDirection.z > absDirection.y )
				face = direction.z > 0.0 ? 2.0 : 5.0;
			else
				face = direction.y > 0.0 ? 1.0 : 4.0;
		}
		return face;
	}
	vec2 getUV( vec3 direction, float face ) {
		vec2 uv;
		if ( face == 0.0 ) {
			uv = vec2( direction.z, direction.y ) / abs( direction.x );
		} else if ( face == 1.0 ) {
			uv = vec2( - direction.x, - direction.z ) / abs( direction.y );
		} else if ( face == 2.0 ) {
			uv = vec2( - direction.x, direction.y ) / abs( direction.z );
		} else if ( face == 3.0 ) {
			uv = vec2( - direction.z, direction.y ) / abs( direction.x );
		} else if ( face == 4.0 ) {
			uv = vec2( - direction.x, direction.z ) / abs( direction.y );
		} else {
			uv = vec2( direction.x, direction.y ) / abs( direction.z );
		}
		return 0.5 * ( uv + 1.0 );
	}
	vec3 bilinearCubeUV( sampler2D envMap, vec3 direction, float mipInt ) {
		float face = getFace( direction );
		float filterInt = max( cubeUV_minMipLevel - mipInt, 0.0 );
		mipInt = max( mipInt, cubeUV_minMipLevel );
		float faceSize = exp2( mipInt );
		highp vec2 uv = getUV( direction, face ) * ( faceSize - 2.0 ) + 1.0;
		if ( face > 2.0 ) {
			uv.y += faceSize;
			face -= 3.0;
		}
		uv.x += face * faceSize;
		uv.x += filterInt * 3.0 * cubeUV_minTileSize;
		uv.y += 4.0 * ( exp2( CUBEUV_MAX_MIP ) - faceSize );
		uv.x *= CUBEUV_TEXEL_WIDTH;
		uv.y *= CUBEUV_TEXEL_HEIGHT;
		#ifdef texture2DGradEXT
			return texture2DGradEXT( envMap, uv, vec2( 0.0 ), vec2( 0.0 ) ).rgb;
		#else
			return texture2D( envMap, uv ).rgb;
		#endif
	}
	#define cubeUV_r0 1.0
	#define cubeUV_m0 - 2.0
	#define cubeUV_r1 0.8
	#define cubeUV_m1 - 1.0
	#define cubeUV_r4 0.4
	#define cubeUV_m4 2.0
	#define cubeUV_r5 0.305
	#define cubeUV_m5 3.0
	#define cubeUV_r6 0.21
	#define cubeUV_m6 4.0
	float roughnessToMip( float roughness ) {
		float mip = 0.0;
		if ( roughness >= cubeUV_r1 ) {
			mip = ( cubeUV_r0 - roughness ) * ( cubeUV_m1 - cubeUV_m0 ) / ( cubeUV_r0 - cubeUV_r1 ) + cubeUV_m0;
		} else if ( roughness >= cubeUV_r4 ) {
			mip = ( cubeUV_r1 - roughness ) * ( cubeUV_m4 - cubeUV_m1 ) / ( cubeUV_r1 - cubeUV_r4 ) + cubeUV_m1;
		} else if ( roughness >= cubeUV_r5 ) {
			mip = ( cubeUV_r4 - roughness ) * ( cubeUV_m5 - cubeUV_m4 ) / ( cubeUV_r4 - cubeUV_r5 ) + cubeUV_m4;
		} else if ( roughness >= cubeUV_r6 ) {
			mip = ( cubeUV_r5 - roughness ) * ( cubeUV_m6 - cubeUV_m5 ) / ( cubeUV_r5 - cubeUV_r6 ) + cubeUV_m5;
		} else {
			mip = - 2.0 * log2( 1.16 * roughness );		}
		return mip;
	}
	vec4 textureCubeUV( sampler2D envMap, vec3 sampleDir, float roughness ) {
		float mip = clamp( roughnessToMip( roughness ), cubeUV_m0, CUBEUV_MAX_MIP );
		float mipF = fract( mip );
		float mipInt = floor( mip );
		vec3 color0 = bilinearCubeUV( envMap, sampleDir, mipInt );
		if ( mipF == 0.0 ) {
			return vec4( color0, 1.0 );
		} else {
			vec3 color1 = bilinearCubeUV( envMap, sampleDir, mipInt + 1.0 );
			return vec4( mix( color0, color1, mipF ), 1.0 );
		}
	}
#endif`,defaultnormal_vertex:`vec3 transformedNormal = objectNormal;
#ifdef USE_TANGENT
	vec3 transformedTangent = objectTangent;
#endif
#ifdef USE_BATCHING
	mat3 bm = mat3( batchingMatrix );
	transformedNormal /= vec3( dot( bm[ 0 ], bm[ 0 ] ), dot( bm[ 1 ], bm[ 1 ] ), dot( bm[ 2 ], bm[ 2 ] ) );
	transformedNormal = bm * transformedNormal;
	#ifdef USE_TANGENT
		transformedTangent = bm * transformedTangent;
	#endif
#endif
#ifdef USE_INSTANCING
	mat3 im = mat3( instanceMatrix );
	transformedNormal /= vec3( dot( im[ 0 ], im[ 0 ] ), dot( im[ 1 ], im[ 1 ] ), dot( im[ 2 ], im[ 2 ] ) );
	transformedNormal = im * transformedNormal;
	#ifdef USE_TANGENT
		transformedTangent = im * transformedTangent;
	#endif
#endif
transformedNormal = normalMatrix * transformedNormal;
#ifdef FLIP_SIDED
	transformedNormal = - transformedNormal;
#endif
#ifdef USE_TANGENT
	transformedTangent = ( modelViewMatrix * vec4( transformedTangent, 0.0 ) ).xyz;
	#ifdef FLIP_SIDED
		transformedTangent = - transformedTangent;
	#endif
#endif`,displacementmap_pars_vertex:`#ifdef USE_DISPLACEMENTMAP
	uniform sampler2D displacementMap;
	uniform float displacementScale;
	uniform float displacementBias;
#endif`,displacementmap_vertex:`#ifdef USE_DISPLACEMENTMAP
	transformed += normalize( objectNormal ) * ( texture2D( displacementMap, vDisplacementMapUv ).x * displacementScale + displacementBias );
#endif`,emissivemap_fragment:`#ifdef USE_EMISSIVEMAP
	vec4 emissiveColor = texture2D( emissiveMap, vEmissiveMapUv );
	#ifdef DECODE_VIDEO_TEXTURE_EMISSIVE
		emissiveColor = sRGBTransferEOTF( emissiveColor );
	#endif
	totalEmissiveRadiance *= emissiveColor.rgb;
#endif`,emissivemap_pars_fragment:`#ifdef USE_EMISSIVEMAP
	uniform sampler2D emissiveMap;
#endif`,colorspace_fragment:"gl_FragColor = linearToOutputTexel( gl_FragColor );",colorspace_pars_fragment:`vec4 LinearTransferOETF( in vec4 value ) {
	return value;
}
vec4 sRGBTransferEOTF( in vec4 value ) {
	return vec4( mix( pow( value.rgb * 0.9478672986 + vec3( 0.0521327014 ), vec3( 2.4 ) ), value.rgb * 0.0773993808, vec3( lessThanEqual( value.rgb, vec3( 0.04045 ) ) ) ), value.a );
}
vec4 sRGBTransferOETF( in vec4 value ) {
	return vec4( mix( pow( value.rgb, vec3( 0.41666 ) ) * 1.055 - vec3( 0.055 ), value.rgb * 12.92, vec3( lessThanEqual( value.rgb, vec3( 0.0031308 ) ) ) ), value.a );
}`,envmap_fragment:`#ifdef USE_ENVMAP
	#ifdef ENV_WORLDPOS
		vec3 cameraToFrag;
		if ( isOrthographic ) {
			cameraToFrag = normalize( vec3( - viewMatrix[ 0 ][ 2 ], - viewMatrix[ 1 ][ 2 ], - viewMatrix[ 2 ][ 2 ] ) );
		} else {
			cameraToFrag = normalize( vWorldPosition - cameraPosition );
		}
		vec3 worldNormal = inverseTransformDirection( normal, viewMatrix );
		#ifdef ENVMAP_MODE_REFLECTION
			vec3 reflectVec = reflect( cameraToFrag, worldNormal );
		#else
			vec3 reflectVec = refract( cameraToFrag, worldNormal, refractionRatio );
		#endif
	#else
		vec3 reflectVec = vReflect;
	#endif
	#ifdef ENVMAP_TYPE_CUBE
		vec4 envColor = textureCube( envMap, envMapRotation * reflectVec );
		#ifdef ENVMAP_BLENDING_MULTIPLY
			outgoingLight = mix( outgoingLight, outgoingLight * envColor.xyz, specularStrength * reflectivity );
		#elif defined( ENVMAP_BLENDING_MIX )
			outgoingLight = mix( outgoingLight, envColor.xyz, specularStrength * reflectivity );
		#elif defined( ENVMAP_BLENDING_ADD )
			outgoingLight += envColor.xyz * specularStrength * reflectivity;
		#endif
	#endif
#endif`,envmap_common_pars_fragment:`#ifdef USE_ENVMAP
	uniform float envMapIntensity;
	uniform mat3 envMapRotation;
	#ifdef ENVMAP_TYPE_CUBE
		uniform samplerCube envMap;
	#else
		uniform sampler2D envMap;
	#endif
#endif`,envmap_pars_fragment:`#ifdef USE_ENVMAP
	uniform float reflectivity;
	#if defined( USE_BUMPMAP ) || defined( USE_NORMALMAP ) || defined( PHONG ) || defined( LAMBERT )
		#define ENV_WORLDPOS
	#endif
	#ifdef ENV_WORLDPOS
		varying vec3 vWorldPosition;
		uniform float refractionRatio;
	#else
		varying vec3 vReflect;
	#endif
#endif`,envmap_pars_vertex:`#ifdef USE_ENVMAP
	#if defined( USE_BUMPMAP ) || defined( USE_NORMALMAP ) || defined( PHONG ) || defined( LAMBERT )
		#define ENV_WORLDPOS
	#endif
	#ifdef ENV_WORLDPOS
		
		varying vec3 vWorldPosition;
	#else
		varying vec3 vReflect;
		uniform float refractionRatio;
	#endif
#endif`,envmap_physical_pars_fragment:`#ifdef USE_ENVMAP
	vec3 getIBLIrradiance( const in vec3 normal ) {
		#ifdef ENVMAP_TYPE_CUBE_UV
			vec3 worldNormal = inverseTransformDirection( normal, viewMatrix );
			vec4 envMapColor = textureCubeUV( envMap, envMapRotation * worldNormal, 1.0 );
			return PI * envMapColor.rgb * envMapIntensity;
		#else
			return vec3( 0.0 );
		#endif
	}
	vec3 getIBLRadiance( const in vec3 viewDir, const in vec3 normal, const in float roughness ) {
		#ifdef ENVMAP_TYPE_CUBE_UV
			vec3 reflectVec = reflect( - viewDir, normal );
			reflectVec = normalize( mix( reflectVec, normal, pow4( roughness ) ) );
			reflectVec = inverseTransformDirection( reflectVec, viewMatrix );
			vec4 envMapColor = textureCubeUV( envMap, envMapRotation * reflectVec, roughness );
			return envMapColor.rgb * envMapIntensity;
		#else
			return vec3( 0.0 );
		#endif
	}
	#ifdef USE_ANISOTROPY
		vec3 getIBLAnisotropyRadiance( const in vec3 viewDir, const in vec3 normal, const in float roughness, const in vec3 bitangent, const in float anisotropy ) {
			#ifdef ENVMAP_TYPE_CUBE_UV
				vec3 bentNormal = cross( bitangent, viewDir );
				bentNormal = normalize( cross( bentNormal, bitangent ) );
				bentNormal = normalize( mix( bentNormal, normal, pow2( pow2( 1.0 - anisotropy * ( 1.0 - roughness ) ) ) ) );
				return getIBLRadiance( viewDir, bentNormal, roughness );
			#else
				return vec3( 0.0 );
			#endif
		}
	#endif
#endif`,envmap_vertex:`#ifdef USE_ENVMAP
	#ifdef ENV_WORLDPOS
		vWorldPosition = worldPosition.xyz;
	#else
		vec3 cameraToVertex;
		if ( isOrthographic ) {
			cameraToVertex = normalize( vec3( - viewMatrix[ 0 ][ 2 ], - viewMatrix[ 1 ][ 2 ], - viewMatrix[ 2 ][ 2 ] ) );
		} else {
			cameraToVertex = normalize( worldPosition.xyz - cameraPosition );
		}
		vec3 worldNormal = inverseTransformDirection( transformedNormal, viewMatrix );
		#ifdef ENVMAP_MODE_REFLECTION
			vReflect = reflect( cameraToVertex, worldNormal );
		#else
			vReflect = refract( cameraToVertex, worldNormal, refractionRatio );
		#endif
	#endif
#endif`,fog_vertex:`#ifdef USE_FOG
	vFogDepth = - mvPosition.z;
#endif`,fog_pars_vertex:`#ifdef USE_FOG
	varying float vFogDepth;
#endif`,fog_fragment:`#ifdef USE_FOG
	#ifdef FOG_EXP2
		float fogFactor = 1.0 - exp( - fogDensity * fogDensity * vFogDepth * vFogDepth );
	#else
		float fogFactor = smoothstep( fogNear, fogFar, vFogDepth );
	#endif
	gl_FragColor.rgb = mix( gl_FragColor.rgb, fogColor, fogFactor );
#endif`,fog_pars_fragment:`#ifdef USE_FOG
	uniform vec3 fogColor;
	varying float vFogDepth;
	#ifdef FOG_EXP2
		uniform float fogDensity;
	#else
		uniform float fogNear;
		uniform float fogFar;
	#endif
#endif`,gradientmap_pars_fragment:`#ifdef USE_GRADIENTMAP
	uniform sampler2D gradientMap;
#endif
vec3 getGradientIrradiance( vec3 normal, vec3 lightDirection ) {
	float dotNL = dot( normal, lightDirection );
	vec2 coord = vec2( dotNL * 0.5 + 0.5, 0.0 );
	#ifdef USE_GRADIENTMAP
		return vec3( texture2D( gradientMap, coord ).r );
	#else
		vec2 fw = fwidth( coord ) * 0.5;
		return mix( vec3( 0.7 ), vec3( 1.0 ), smoothstep( 0.7 - fw.x, 0.7 + fw.x, coord.x ) );
	#endif
}`,lightmap_pars_fragment:`#ifdef USE_LIGHTMAP
	uniform sampler2D lightMap;
	uniform float lightMapIntensity;
#endif`,lights_lambert_fragment:`LambertMaterial material;
material.diffuseColor = diffuseColor.rgb;
material.specularStrength = specularStrength;`,lights_lambert_pars_fragment:`varying vec3 vViewPosition;
struct LambertMaterial {
	vec3 diffuseColor;
	float specularStrength;
};
void RE_Direct_Lambert( const in IncidentLight directLight, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in LambertMaterial material, inout ReflectedLight reflectedLight ) {
	float dotNL = saturate( dot( geometryNormal, directLight.direction ) );
	vec3 irradiance = dotNL * directLight.color;
	reflectedLight.directDiffuse += irradiance * BRDF_Lambert( material.diffuseColor );
}
void RE_IndirectDiffuse_Lambert( const in vec3 irradiance, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in LambertMaterial material, inout ReflectedLight reflectedLight ) {
	reflectedLight.indirectDiffuse += irradiance * BRDF_Lambert( material.diffuseColor );
}
#define RE_Direct				RE_Direct_Lambert
#define RE_IndirectDiffuse		RE_IndirectDiffuse_Lambert`,lights_pars_begin:`uniform bool receiveShadow;
uniform vec3 ambientLightColor;
#if defined( USE_LIGHT_PROBES )
	uniform vec3 lightProbe[ 9 ];
#endif
vec3 shGetIrradianceAt( in vec3 normal, in vec3 shCoefficients[ 9 ] ) {
	float x = normal.x, y = normal.y, z = normal.z;
	vec3 result = shCoefficients[ 0 ] * 0.886227;
	result += shCoefficients[ 1 ] * 2.0 * 0.511664 * y;
	result += shCoefficients[ 2 ] * 2.0 * 0.511664 * z;
	result += shCoefficients[ 3 ] * 2.0 * 0.511664 * x;
	result += shCoefficients[ 4 ] * 2.0 * 0.429043 * x * y;
	result += shCoefficients[ 5 ] * 2.0 * 0.429043 * y * z;
	result += shCoefficients[ 6 ] * ( 0.743125 * z * z - 0.247708 );
	result += shCoefficients[ 7 ] * 2.0 * 0.429043 * x * z;
	result += shCoefficients[ 8 ] * 0.429043 * ( x * x - y * y );
	return result;
}
vec3 getLightProbeIrradiance( const in vec3 lightProbe[ 9 ], const in vec3 normal ) {
	vec3 worldNormal = inverseTransformDirection( normal, viewMatrix );
	vec3 irradiance = shGetIrradianceAt( worldNormal, lightProbe );
	return irradiance;
}
vec3 getAmbientLightIrradiance( const in vec3 ambientLightColor ) {
	vec3 irradiance = ambientLightColor;
	return irradiance;
}
float getDistanceAttenuation( const in float lightDistance, const in float cutoffDistance, const in float decayExponent ) {
	float distanceFalloff = 1.0 / max( pow( lightDistance, decayExponent ), 0.01 );
	if ( cutoffDistance > 0.0 ) {
		distanceFalloff *= pow2( saturate( 1.0 - pow4( lightDistance / cutoffDistance ) ) );
	}
	return distanceFalloff;
}
float getSpotAttenuation( const in float coneCosine, const in float penumbraCosine, const in float angleCosine ) {
	return smoothstep( coneCosine, penumbraCosine, angleCosine );
}
#if NUM_DIR_LIGHTS > 0
	struct DirectionalLight {
		vec3 direction;
		vec3 color;
	};
	uniform DirectionalLight directionalLights[ NUM_DIR_LIGHTS ];
	void getDirectionalLightInfo( const in DirectionalLight directionalLight, out IncidentLight light ) {
		light.color = directionalLight.color;
		light.direction = directionalLight.direction;
		light.visible = true;
	}
#endif
#if NUM_POINT_LIGHTS > 0
	struct PointLight {
		vec3 position;
		vec3 color;
		float distance;
		float decay;
	};
	uniform PointLight pointLights[ NUM_POINT_LIGHTS ];
	void getPointLightInfo( const in PointLight pointLight, const in vec3 geometryPosition, out IncidentLight light ) {
		vec3 lVector = pointLight.position - geometryPosition;
		light.direction = normalize( lVector );
		float lightDistance = length( lVector );
		light.color = pointLight.color;
		light.color *= getDistanceAttenuation( lightDistance, pointLight.distance, pointLight.decay );
		light.visible = ( light.color != vec3( 0.0 ) );
	}
#endif
#if NUM_SPOT_LIGHTS > 0
	struct SpotLight {
		vec3 position;
		vec3 direction;
		vec3 color;
		float distance;
		float decay;
		float coneCos;
		float penumbraCos;
	};
	uniform SpotLight spotLights[ NUM_SPOT_LIGHTS ];
	void getSpotLightInfo( const in SpotLight spotLight, const in vec3 geometryPosition, out IncidentLight light ) {
		vec3 lVector = spotLight.position - geometryPosition;
		light.direction = normalize( lVector );
		float angleCos = dot( light.direction, spotLight.direction );
		float spotAttenuation = getSpotAttenuation( spotLight.coneCos, spotLight.penumbraCos, angleCos );
		if ( spotAttenuation > 0.0 ) {
			float lightDistance = length( lVector );
			light.color = spotLight.color * spotAttenuation;
			light.color *= getDistanceAttenuation( lightDistance, spotLight.distance, spotLight.decay );
			light.visible = ( light.color != vec3( 0.0 ) );
		} else {
			light.color = vec3( 0.0 );
			light.visible = false;
		}
	}
#endif
#if NUM_RECT_AREA_LIGHTS > 0
	struct RectAreaLight {
		vec3 color;
		vec3 position;
		vec3 halfWidth;
		vec3 halfHeight;
	};
	uniform sampler2D ltc_1;	uniform sampler2D ltc_2;
	uniform RectAreaLight rectAreaLights[ NUM_RECT_AREA_LIGHTS ];
#endif
#if NUM_HEMI_LIGHTS > 0
	struct HemisphereLight {
		vec3 direction;
		vec3 skyColor;
		vec3 groundColor;
	};
	uniform HemisphereLight hemisphereLights[ NUM_HEMI_LIGHTS ];
	vec3 getHemisphereLightIrradiance( const in HemisphereLight hemiLight, const in vec3 normal ) {
		float dotNL = dot( normal, hemiLight.direction );
		float hemiDiffuseWeight = 0.5 * dotNL + 0.5;
		vec3 irradiance = mix( hemiLight.groundColor, hemiLight.skyColor, hemiDiffuseWeight );
		return irradiance;
	}
#endif
#include <lightprobes_pars_fragment>`,lights_toon_fragment:`ToonMaterial material;
material.diffuseColor = diffuseColor.rgb;`,lights_toon_pars_fragment:`varying vec3 vViewPosition;
struct ToonMaterial {
	vec3 diffuseColor;
};
void RE_Direct_Toon( const in IncidentLight directLight, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in ToonMaterial material, inout ReflectedLight reflectedLight ) {
	vec3 irradiance = getGradientIrradiance( geometryNormal, directLight.direction ) * directLight.color;
	reflectedLight.directDiffuse += irradiance * BRDF_Lambert( material.diffuseColor );
}
void RE_IndirectDiffuse_Toon( const in vec3 irradiance, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in ToonMaterial material, inout ReflectedLight reflectedLight ) {
	reflectedLight.indirectDiffuse += irradiance * BRDF_Lambert( material.diffuseColor );
}
#define RE_Direct				RE_Direct_Toon
#define RE_IndirectDiffuse		RE_IndirectDiffuse_Toon`,lights_phong_fragment:`BlinnPhongMaterial material;
material.diffuseColor = diffuseColor.rgb;
material.specularColor = specular;
material.specularShininess = shininess;
material.specularStrength = specularStrength;`,lights_phong_pars_fragment:`varying vec3 vViewPosition;
struct BlinnPhongMaterial {
	vec3 diffuseColor;
	vec3 specularColor;
	float specularShininess;
	float specularStrength;
};
void RE_Direct_BlinnPhong( const in IncidentLight directLight, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in BlinnPhongMaterial material, inout ReflectedLight reflectedLight ) {
	float dotNL = saturate( dot( geometryNormal, directLight.direction ) );
	vec3 irradiance = dotNL * directLight.color;
	reflectedLight.directDiffuse += irradiance * BRDF_Lambert( material.diffuseColor );
	reflectedLight.directSpecular += irradiance * BRDF_BlinnPhong( directLight.direction, geometryViewDir, geometryNormal, material.specularColor, material.specularShininess ) * material.specularStrength;
}
void RE_IndirectDiffuse_BlinnPhong( const in vec3 irradiance, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in BlinnPhongMaterial material, inout ReflectedLight reflectedLight ) {
	reflectedLight.indirectDiffuse += irradiance * BRDF_Lambert( material.diffuseColor );
}
#define RE_Direct				RE_Direct_BlinnPhong
#define RE_IndirectDiffuse		RE_IndirectDiffuse_BlinnPhong`,lights_physical_fragment:`PhysicalMaterial material;
material.diffuseColor = diffuseColor.rgb;
material.diffuseContribution = diffuseColor.rgb * ( 1.0 - metalnessFactor );
material.metalness = metalnessFactor;
vec3 dxy = max( abs( dFdx( nonPerturbedNormal ) ), abs( dFdy( nonPerturbedNormal ) ) );
float geometryRoughness = max( max( dxy.x, dxy.y ), dxy.z );
material.roughness = max( roughnessFactor, 0.0525 );material.roughness += geometryRoughness;
material.roughness = min( material.roughness, 1.0 );
#ifdef IOR
	material.ior = ior;
	#ifdef USE_SPECULAR
		float specularIntensityFactor = specularIntensity;
		vec3 specularColorFactor = specularColor;
		#ifdef USE_SPECULAR_COLORMAP
			specularColorFactor *= texture2D( specularColorMap, vSpecularColorMapUv ).rgb;
		#endif
		#ifdef USE_SPECULAR_INTENSITYMAP
			specularIntensityFactor *= texture2D( specularIntensityMap, vSpecularIntensityMapUv ).a;
		#endif
		material.specularF90 = mix( specularIntensityFactor, 1.0, metalnessFactor );
	#else
		float specularIntensityFactor = 1.0;
		vec3 specularColorFactor = vec3( 1.0 );
		material.specularF90 = 1.0;
	#endif
	material.specularColor = min( pow2( ( material.ior - 1.0 ) / ( material.ior + 1.0 ) ) * specularColorFactor, vec3( 1.0 ) ) * specularIntensityFactor;
	material.specularColorBlended = mix( material.specularColor, diffuseColor.rgb, metalnessFactor );
#else
	material.specularColor = vec3( 0.04 );
	material.specularColorBlended = mix( material.specularColor, diffuseColor.rgb, metalnessFactor );
	material.specularF90 = 1.0;
#endif
#ifdef USE_CLEARCOAT
	material.clearcoat = clearcoat;
	material.clearcoatRoughness = clearcoatRoughness;
	material.clearcoatF0 = vec3( 0.04 );
	material.clearcoatF90 = 1.0;
	#ifdef USE_CLEARCOATMAP
		material.clearcoat *= texture2D( clearcoatMap, vClearcoatMapUv ).x;
	#endif
	#ifdef USE_CLEARCOAT_ROUGHNESSMAP
		material.clearcoatRoughness *= texture2D( clearcoatRoughnessMap, vClearcoatRoughnessMapUv ).y;
	#endif
	material.clearcoat = saturate( material.clearcoat );	material.clearcoatRoughness = max( material.clearcoatRoughness, 0.0525 );
	material.clearcoatRoughness += geometryRoughness;
	material.clearcoatRoughness = min( material.clearcoatRoughness, 1.0 );
#endif
#ifdef USE_DISPERSION
	material.dispersion = dispersion;
#endif
#ifdef USE_IRIDESCENCE
	material.iridescence = iridescence;
	material.iridescenceIOR = iridescenceIOR;
	#ifdef USE_IRIDESCENCEMAP
		material.iridescence *= texture2D( iridescenceMap, vIridescenceMapUv ).r;
	#endif
	#ifdef USE_IRIDESCENCE_THICKNESSMAP
		material.iridescenceThickness = (iridescenceThicknessMaximum - iridescenceThicknessMinimum) * texture2D( iridescenceThicknessMap, vIridescenceThicknessMapUv ).g + iridescenceThicknessMinimum;
	#else
		material.iridescenceThickness = iridescenceThicknessMaximum;
	#endif
#endif
#ifdef USE_SHEEN
	material.sheenColor = sheenColor;
	#ifdef USE_SHEEN_COLORMAP
		material.sheenColor *= texture2D( sheenColorMap, vSheenColorMapUv ).rgb;
	#endif
	material.sheenRoughness = clamp( sheenRoughness, 0.0001, 1.0 );
	#ifdef USE_SHEEN_ROUGHNESSMAP
		material.sheenRoughness *= texture2D( sheenRoughnessMap, vSheenRoughnessMapUv ).a;
	#endif
#endif
#ifdef USE_ANISOTROPY
	#ifdef USE_ANISOTROPYMAP
		mat2 anisotropyMat = mat2( anisotropyVector.x, anisotropyVector.y, - anisotropyVector.y, anisotropyVector.x );
		vec3 anisotropyPolar = texture2D( anisotropyMap, vAnisotropyMapUv ).rgb;
		vec2 anisotropyV = anisotropyMat * normalize( 2.0 * anisotropyPolar.rg - vec2( 1.0 ) ) * anisotropyPolar.b;
	#else
		vec2 anisotropyV = anisotropyVector;
	#endif
	material.anisotropy = length( anisotropyV );
	if( material.anisotropy == 0.0 ) {
		anisotropyV = vec2( 1.0, 0.0 );
	} else {
		anisotropyV /= material.anisotropy;
		material.anisotropy = saturate( material.anisotropy );
	}
	material.alphaT = mix( pow2( material.roughness ), 1.0, pow2( material.anisotropy ) );
	material.anisotropyT = tbn[ 0 ] * anisotropyV.x + tbn[ 1 ] * anisotropyV.y;
	material.anisotropyB = tbn[ 1 ] * anisotropyV.x - tbn[ 0 ] * anisotropyV.y;
#endif`,lights_physical_pars_fragment:`uniform sampler2D dfgLUT;
struct PhysicalMaterial {
	vec3 diffuseColor;
	vec3 diffuseContribution;
	vec3 specularColor;
	vec3 specularColorBlended;
	float roughness;
	float metalness;
	float specularF90;
	float dispersion;
	#ifdef USE_CLEARCOAT
		float clearcoat;
		float clearcoatRoughness;
		vec3 clearcoatF0;
		float clearcoatF90;
	#endif
	#ifdef USE_IRIDESCENCE
		float iridescence;
		float iridescenceIOR;
		float iridescenceThickness;
		vec3 iridescenceFresnel;
		vec3 iridescenceF0;
		vec3 iridescenceFresnelDielectric;
		vec3 iridescenceFresnelMetallic;
	#endif
	#ifdef USE_SHEEN
		vec3 sheenColor;
		float sheenRoughness;
	#endif
	#ifdef IOR
		float ior;
	#endif
	#ifdef USE_TRANSMISSION
		float transmission;
		float transmissionAlpha;
		float thickness;
		float attenuationDistance;
		vec3 attenuationColor;
	#endif
	#ifdef USE_ANISOTROPY
		float anisotropy;
		float alphaT;
		vec3 anisotropyT;
		vec3 anisotropyB;
	#endif
};
vec3 clearcoatSpecularDirect = vec3( 0.0 );
vec3 clearcoatSpecularIndirect = vec3( 0.0 );
vec3 sheenSpecularDirect = vec3( 0.0 );
vec3 sheenSpecularIndirect = vec3(0.0 );
vec3 Schlick_to_F0( const in vec3 f, const in float f90, const in float dotVH ) {
    float x = clamp( 1.0 - dotVH, 0.0, 1.0 );
    float x2 = x * x;
    float x5 = clamp( x * x2 * x2, 0.0, 0.9999 );
    return ( f - vec3( f90 ) * x5 ) / ( 1.0 - x5 );
}
float V_GGX_SmithCorrelated( const in float alpha, const in float dotNL, const in float dotNV ) {
	float a2 = pow2( alpha );
	float gv = dotNL * sqrt( a2 + ( 1.0 - a2 ) * pow2( dotNV ) );
	float gl = dotNV * sqrt( a2 + ( 1.0 - a2 ) * pow2( dotNL ) );
	return 0.5 / max( gv + gl, EPSILON );
}
float D_GGX( const in float alpha, const in float dotNH ) {
	float a2 = pow2( alpha );
	float denom = pow2( dotNH ) * ( a2 - 1.0 ) + 1.0;
	return RECIPROCAL_PI * a2 / pow2( denom );
}
#ifdef USE_ANISOTROPY
	float V_GGX_SmithCorrelated_Anisotropic( const in float alphaT, const in float alphaB, const in float dotTV, const in float dotBV, const in float dotTL, const in float dotBL, const in float dotNV, const in float dotNL ) {
		float gv = dotNL * length( vec3( alphaT * dotTV, alphaB * dotBV, dotNV ) );
		float gl = dotNV * length( vec3( alphaT * dotTL, alphaB * dotBL, dotNL ) );
		return 0.5 / max( gv + gl, EPSILON );
	}
	float D_GGX_Anisotropic( const in float alphaT, const in float alphaB, const in float dotNH, const in float dotTH, const in float dotBH ) {
		float a2 = alphaT * alphaB;
		highp vec3 v = vec3( alphaB * dotTH, alphaT * dotBH, a2 * dotNH );
		highp float v2 = dot( v, v );
		float w2 = a2 / v2;
		return RECIPROCAL_PI * a2 * pow2 ( w2 );
	}
#endif
#ifdef USE_CLEARCOAT
	vec3 BRDF_GGX_Clearcoat( const in vec3 lightDir, const in vec3 viewDir, const in vec3 normal, const in PhysicalMaterial material) {
		vec3 f0 = material.clearcoatF0;
		float f90 = material.clearcoatF90;
		float roughness = material.clearcoatRoughness;
		float alpha = pow2( roughness );
		vec3 halfDir = normalize( lightDir + viewDir );
		float dotNL = saturate( dot( normal, lightDir ) );
		float dotNV = saturate( dot( normal, viewDir ) );
		float dotNH = saturate( dot( normal, halfDir ) );
		float dotVH = saturate( dot( viewDir, halfDir ) );
		vec3 F = F_Schlick( f0, f90, dotVH );
		float V = V_GGX_SmithCorrelated( alpha, dotNL, dotNV );
		float D = D_GGX( alpha, dotNH );
		return F * ( V * D );
	}
#endif
vec3 BRDF_GGX( const in vec3 lightDir, const in vec3 viewDir, const in vec3 normal, const in PhysicalMaterial material ) {
	vec3 f0 = material.specularColorBlended;
	float f90 = material.specularF90;
	float roughness = material.roughness;
	float alpha = pow2( roughness );
	vec3 halfDir = normalize( lightDir + viewDir );
	float dotNL = saturate( dot( normal, lightDir ) );
	float dotNV = saturate( dot( normal, viewDir ) );
	float dotNH = saturate( dot( normal, halfDir ) );
	float dotVH = saturate( dot( viewDir, halfDir ) );
	vec3 F = F_Schlick( f0, f90, dotVH );
	#ifdef USE_IRIDESCENCE
		F = mix( F, material.iridescenceFresnel, material.iridescence );
	#endif
	#ifdef USE_ANISOTROPY
		float dotTL = dot( material.anisotropyT, lightDir );
		float dotTV = dot( material.anisotropyT, viewDir );
		float dotTH = dot( material.anisotropyT, halfDir );
		float dotBL = dot( material.anisotropyB, lightDir );
		float dotBV = dot( material.anisotropyB, viewDir );
		float dotBH = dot( material.anisotropyB, halfDir );
		float V = V_GGX_SmithCorrelated_Anisotropic( material.alphaT, alpha, dotTV, dotBV, dotTL, dotBL, dotNV, dotNL );
		float D = D_GGX_Anisotropic( material.alphaT, alpha, dotNH, dotTH, dotBH );
	#else
		float V = V_GGX_SmithCorrelated( alpha, dotNL, dotNV );
		float D = D_GGX( alpha, dotNH );
	#endif
	return F * ( V * D );
}
vec2 LTC_Uv( const in vec3 N, const in vec3 V, const in float roughness ) {
	const float LUT_SIZE = 64.0;
	const float LUT_SCALE = ( LUT_SIZE - 1.0 ) / LUT_SIZE;
	const float LUT_BIAS = 0.5 / LUT_SIZE;
	float dotNV = saturate( dot( N, V ) );
	vec2 uv = vec2( roughness, sqrt( 1.0 - dotNV ) );
	uv = uv * LUT_SCALE + LUT_BIAS;
	return uv;
}
float LTC_ClippedSphereFormFactor( const in vec3 f ) {
	float l = length( f );
	return max( ( l * l + f.z ) / ( l + 1.0 ), 0.0 );
}
vec3 LTC_EdgeVectorFormFactor( const in vec3 v1, const in vec3 v2 ) {
	float x = dot( v1, v2 );
	float y = abs( x );
	float a = 0.8543985 + ( 0.4965155 + 0.0145206 * y ) * y;
	float b = 3.4175940 + ( 4.1616724 + y ) * y;
	float v = a / b;
	float theta_sintheta = ( x > 0.0 ) ? v : 0.5 * inversesqrt( max( 1.0 - x * x, 1e-7 ) ) - v;
	return cross( v1, v2 ) * theta_sintheta;
}
vec3 LTC_Evaluate( const in vec3 N, const in vec3 V, const in vec3 P, const in mat3 mInv, const in vec3 rectCoords[ 4 ] ) {
	vec3 v1 = rectCoords[ 1 ] - rectCoords[ 0 ];
	vec3 v2 = rectCoords[ 3 ] - rectCoords[ 0 ];
	vec3 lightNormal = cross( v1, v2 );
	if( dot( lightNormal, P - rectCoords[ 0 ] ) < 0.0 ) return vec3( 0.0 );
	vec3 T1, T2;
	T1 = normalize( V - N * dot( V, N ) );
	T2 = - cross( N, T1 );
	mat3 mat = mInv * transpose( mat3( T1, T2, N ) );
	vec3 coords[ 4 ];
	coords[ 0 ] = mat * ( rectCoords[ 0 ] - P );
	coords[ 1 ] = mat * ( rectCoords[ 1 ] - P );
	coords[ 2 ] = mat * ( rectCoords[ 2 ] - P );
	coords[ 3 ] = mat * ( rectCoords[ 3 ] - P );
	coords[ 0 ] = normalize( coords[ 0 ] );
	coords[ 1 ] = normalize( coords[ 1 ] );
	coords[ 2 ] = normalize( coords[ 2 ] );
	coords[ 3 ] = normalize( coords[ 3 ] );
	vec3 vectorFormFactor = vec3( 0.0 );
	vectorFormFactor += LTC_EdgeVectorFormFactor( coords[ 0 ], coords[ 1 ] );
	vectorFormFactor += LTC_EdgeVectorFormFactor( coords[ 1 ], coords[ 2 ] );
	vectorFormFactor += LTC_EdgeVectorFormFactor( coords[ 2 ], coords[ 3 ] );
	vectorFormFactor += LTC_EdgeVectorFormFactor( coords[ 3 ], coords[ 0 ] );
	float result = LTC_ClippedSphereFormFactor( vectorFormFactor );
	return vec3( result );
}
#if defined( USE_SHEEN )
float D_Charlie( float roughness, float dotNH ) {
	float alpha = pow2( roughness );
	float invAlpha = 1.0 / alpha;
	float cos2h = dotNH * dotNH;
	float sin2h = max( 1.0 - cos2h, 0.0078125 );
	return ( 2.0 + invAlpha ) * pow( sin2h, invAlpha * 0.5 ) / ( 2.0 * PI );
}
float V_Neubelt( float dotNV, float dotNL ) {
	return saturate( 1.0 / ( 4.0 * ( dotNL + dotNV - dotNL * dotNV ) ) );
}
vec3 BRDF_Sheen( const in vec3 lightDir, const in vec3 viewDir, const in vec3 normal, vec3 sheenColor, const in float sheenRoughness ) {
	vec3 halfDir = normalize( lightDir + viewDir );
	float dotNL = saturate( dot( normal, lightDir ) );
	float dotNV = saturate( dot( normal, viewDir ) );
	float dotNH = saturate( dot( normal, halfDir ) );
	float D = D_Charlie( sheenRoughness, dotNH );
	float V = V_Neubelt( dotNV, dotNL );
	return sheenColor * ( D * V );
}
#endif
float IBLSheenBRDF( const in vec3 normal, const in vec3 viewDir, const in float roughness ) {
	float dotNV = saturate( dot( normal, viewDir ) );
	float r2 = roughness * roughness;
	float rInv = 1.0 / ( roughness + 0.1 );
	float a = -1.9362 + 1.0678 * roughness + 0.4573 * r2 - 0.8469 * rInv;
	float b = -0.6014 + 0.5538 * roughness - 0.4670 * r2 - 0.1255 * rInv;
	float DG = exp( a * dotNV + b );
	return saturate( DG );
}
vec3 EnvironmentBRDF( const in vec3 normal, const in vec3 viewDir, const in vec3 specularColor, const in float specularF90, const in float roughness ) {
	float dotNV = saturate( dot( normal, viewDir ) );
	vec2 fab = texture2D( dfgLUT, vec2( roughness, dotNV ) ).rg;
	return specularColor * fab.x + specularF90 * fab.y;
}
#ifdef USE_IRIDESCENCE
void computeMultiscatteringIridescence( const in vec3 normal, const in vec3 viewDir, const in vec3 specularColor, const in float specularF90, const in float iridescence, const in vec3 iridescenceF0, const in float roughness, inout vec3 singleScatter, inout vec3 multiScatter ) {
#else
void computeMultiscattering( const in vec3 normal, const in vec3 viewDir, const in vec3 specularColor, const in float specularF90, const in float roughness, inout vec3 singleScatter, inout vec3 multiScatter ) {
#endif
	float dotNV = saturate( dot( normal, viewDir ) );
	vec2 fab = texture2D( dfgLUT, vec2( roughness, dotNV ) ).rg;
	#ifdef USE_IRIDESCENCE
		vec3 Fr = mix( specularColor, iridescenceF0, iridescence );
	#else
		vec3 Fr = specularColor;
	#endif
	vec3 FssEss = Fr * fab.x + specularF90 * fab.y;
	float Ess = fab.x + fab.y;
	float Ems = 1.0 - Ess;
	vec3 Favg = Fr + ( 1.0 - Fr ) * 0.047619;	vec3 Fms = FssEss * Favg / ( 1.0 - Ems * Favg );
	singleScatter += FssEss;
	multiScatter += Fms * Ems;
}
vec3 BRDF_GGX_Multiscatter( const in vec3 lightDir, const in vec3 viewDir, const in vec3 normal, const in PhysicalMaterial material ) {
	vec3 singleScatter = BRDF_GGX( lightDir, viewDir, normal, material );
	float dotNL = saturate( dot( normal, lightDir ) );
	float dotNV = saturate( dot( normal, viewDir ) );
	vec2 dfgV = texture2D( dfgLUT, vec2( material.roughness, dotNV ) ).rg;
	vec2 dfgL = texture2D( dfgLUT, vec2( material.roughness, dotNL ) ).rg;
	vec3 FssEss_V = material.specularColorBlended * dfgV.x + material.specularF90 * dfgV.y;
	vec3 FssEss_L = material.specularColorBlended * dfgL.x + material.specularF90 * dfgL.y;
	float Ess_V = dfgV.x + dfgV.y;
	float Ess_L = dfgL.x + dfgL.y;
	float Ems_V = 1.0 - Ess_V;
	float Ems_L = 1.0 - Ess_L;
	vec3 Favg = material.specularColorBlended + ( 1.0 - material.specularColorBlended ) * 0.047619;
	vec3 Fms = FssEss_V * FssEss_L * Favg / ( 1.0 - Ems_V * Ems_L * Favg + EPSILON );
	float compensationFactor = Ems_V * Ems_L;
	vec3 multiScatter = Fms * compensationFactor;
	return singleScatter + multiScatter;
}
#if NUM_RECT_AREA_LIGHTS > 0
	void RE_Direct_RectArea_Physical( const in RectAreaLight rectAreaLight, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in PhysicalMaterial material, inout ReflectedLight reflectedLight ) {
		vec3 normal = geometryNormal;
		vec3 viewDir = geometryViewDir;
		vec3 position = geometryPosition;
		vec3 lightPos = rectAreaLight.position;
		vec3 halfWidth = rectAreaLight.halfWidth;
		vec3 halfHeight = rectAreaLight.halfHeight;
		vec3 lightColor = rectAreaLight.color;
		float roughness = material.roughness;
		vec3 rectCoords[ 4 ];
		rectCoords[ 0 ] = lightPos + halfWidth - halfHeight;		rectCoords[ 1 ] = lightPos - halfWidth - halfHeight;
		rectCoords[ 2 ] = lightPos - halfWidth + halfHeight;
		rectCoords[ 3 ] = lightPos + halfWidth + halfHeight;
		vec2 uv = LTC_Uv( normal, viewDir, roughness );
		vec4 t1 = texture2D( ltc_1, uv );
		vec4 t2 = texture2D( ltc_2, uv );
		mat3 mInv = mat3(
			vec3( t1.x, 0, t1.y ),
			vec3(    0, 1,    0 ),
			vec3( t1.z, 0, t1.w )
		);
		vec3 fresnel = ( material.specularColorBlended * t2.x + ( material.specularF90 - material.specularColorBlended ) * t2.y );
		reflectedLight.directSpecular += lightColor * fresnel * LTC_Evaluate( normal, viewDir, position, mInv, rectCoords );
		reflectedLight.directDiffuse += lightColor * material.diffuseContribution * LTC_Evaluate( normal, viewDir, position, mat3( 1.0 ), rectCoords );
		#ifdef USE_CLEARCOAT
			vec3 Ncc = geometryClearcoatNormal;
			vec2 uvClearcoat = LTC_Uv( Ncc, viewDir, material.clearcoatRoughness );
			vec4 t1Clearcoat = texture2D( ltc_1, uvClearcoat );
			vec4 t2Clearcoat = texture2D( ltc_2, uvClearcoat );
			mat3 mInvClearcoat = mat3(
				vec3( t1Clearcoat.x, 0, t1Clearcoat.y ),
				vec3(             0, 1,             0 ),
				vec3( t1Clearcoat.z, 0, t1Clearcoat.w )
			);
			vec3 fresnelClearcoat = material.clearcoatF0 * t2Clearcoat.x + ( material.clearcoatF90 - material.clearcoatF0 ) * t2Clearcoat.y;
			clearcoatSpecularDirect += lightColor * fresnelClearcoat * LTC_Evaluate( Ncc, viewDir, position, mInvClearcoat, rectCoords );
		#endif
	}
#endif
void RE_Direct_Physical( const in IncidentLight directLight, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in PhysicalMaterial material, inout ReflectedLight reflectedLight ) {
	float dotNL = saturate( dot( geometryNormal, directLight.direction ) );
	vec3 irradiance = dotNL * directLight.color;
	#ifdef USE_CLEARCOAT
		float dotNLcc = saturate( dot( geometryClearcoatNormal, directLight.direction ) );
		vec3 ccIrradiance = dotNLcc * directLight.color;
		clearcoatSpecularDirect += ccIrradiance * BRDF_GGX_Clearcoat( directLight.direction, geometryViewDir, geometryClearcoatNormal, material );
	#endif
	#ifdef USE_SHEEN
 
 		sheenSpecularDirect += irradiance * BRDF_Sheen( directLight.direction, geometryViewDir, geometryNormal, material.sheenColor, material.sheenRoughness );
 
 		float sheenAlbedoV = IBLSheenBRDF( geometryNormal, geometryViewDir, material.sheenRoughness );
 		float sheenAlbedoL = IBLSheenBRDF( geometryNormal, directLight.direction, material.sheenRoughness );
 
 		float sheenEnergyComp = 1.0 - max3( material.sheenColor ) * max( sheenAlbedoV, sheenAlbedoL );
 
 		irradiance *= sheenEnergyComp;
 
 	#endif
	reflectedLight.directSpecular += irradiance * BRDF_GGX_Multiscatter( directLight.direction, geometryViewDir, geometryNormal, material );
	reflectedLight.directDiffuse += irradiance * BRDF_Lambert( material.diffuseContribution );
}
void RE_IndirectDiffuse_Physical( const in vec3 irradiance, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in PhysicalMaterial material, inout ReflectedLight reflectedLight ) {
	vec3 diffuse = irradiance * BRDF_Lambert( material.diffuseContribution );
	#ifdef USE_SHEEN
		float sheenAlbedo = IBLSheenBRDF( geometryNormal, geometryViewDir, material.sheenRoughness );
		float sheenEnergyComp = 1.0 - max3( material.sheenColor ) * sheenAlbedo;
		diffuse *= sheenEnergyComp;
	#endif
	reflectedLight.indirectDiffuse += diffuse;
}
void RE_IndirectSpecular_Physical( const in vec3 radiance, const in vec3 irradiance, const in vec3 clearcoatRadiance, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in PhysicalMaterial material, inout ReflectedLight reflectedLight) {
	#ifdef USE_CLEARCOAT
		clearcoatSpecularIndirect += clearcoatRadiance * EnvironmentBRDF( geometryClearcoatNormal, geometryViewDir, material.clearcoatF0, material.clearcoatF90, material.clearcoatRoughness );
	#endif
	#ifdef USE_SHEEN
		sheenSpecularIndirect += irradiance * material.sheenColor * IBLSheenBRDF( geometryNormal, geometryViewDir, material.sheenRoughness ) * RECIPROCAL_PI;
 	#endif
	vec3 singleScatteringDielectric = vec3( 0.0 );
	vec3 multiScatteringDielectric = vec3( 0.0 );
	vec3 singleScatteringMetallic = vec3( 0.0 );
	vec3 multiScatteringMetallic = vec3( 0.0 );
	#ifdef USE_IRIDESCENCE
		computeMultiscatteringIridescence( geometryNormal, geometryViewDir, material.specularColor, material.specularF90, material.iridescence, material.iridescenceFresnelDielectric, material.roughness, singleScatteringDielectric, multiScatteringDielectric );
		computeMultiscatteringIridescence( geometryNormal, geometryViewDir, material.diffuseColor, material.specularF90, material.iridescence, material.iridescenceFresnelMetallic, material.roughness, singleScatteringMetallic, multiScatteringMetallic );
	#else
		computeMultiscattering( geometryNormal, geometryViewDir, material.specularColor, material.specularF90, material.roughness, singleScatteringDielectric, multiScatteringDielectric );
		computeMultiscattering( geometryNormal, geometryViewDir, material.diffuseColor, material.specularF90, material.roughness, singleScatteringMetallic, multiScatteringMetallic );
	#endif
	vec3 singleScattering = mix( singleScatteringDielectric, singleScatteringMetallic, material.metalness );
	vec3 multiScattering = mix( multiScatteringDielectric, multiScatteringMetallic, material.metalness );
	vec3 totalScatteringDielectric = singleScatteringDielectric + multiScatteringDielectric;
	vec3 diffuse = material.diffuseContribution * ( 1.0 - totalScatteringDielectric );
	vec3 cosineWeightedIrradiance = irradiance * RECIPROCAL_PI;
	vec3 indirectSpecular = radiance * singleScattering;
	indirectSpecular += multiScattering * cosineWeightedIrradiance;
	vec3 indirectDiffuse = diffuse * cosineWeightedIrradiance;
	#ifdef USE_SHEEN
		float sheenAlbedo = IBLSheenBRDF( geometryNormal, geometryViewDir, material.sheenRoughness );
		float sheenEnergyComp = 1.0 - max3( material.sheenColor ) * sheenAlbedo;
		indirectSpecular *= sheenEnergyComp;
		indirectDiffuse *= sheenEnergyComp;
	#endif
	reflectedLight.indirectSpecular += indirectSpecular;
	reflectedLight.indirectDiffuse += indirectDiffuse;
}
#define RE_Direct				RE_Direct_Physical
#define RE_Direct_RectArea		RE_Direct_RectArea_Physical
#define RE_IndirectDiffuse		RE_IndirectDiffuse_Physical
#define RE_IndirectSpecular		RE_IndirectSpecular_Physical
float computeSpecularOcclusion( const in float dotNV, const in float ambientOcclusion, const in float roughness ) {
	return saturate( pow( dotNV + ambientOcclusion, exp2( - 16.0 * roughness - 1.0 ) ) - 1.0 + ambientOcclusion );
}`,lights_fragment_begin:`
vec3 geometryPosition = - vViewPosition;
vec3 geometryNormal = normal;
vec3 geometryViewDir = ( isOrthographic ) ? vec3( 0, 0, 1 ) : normalize( vViewPosition );
vec3 geometryClearcoatNormal = vec3( 0.0 );
#ifdef USE_CLEARCOAT
	geometryClearcoatNormal = clearcoatNormal;
#endif
#ifdef USE_IRIDESCENCE
	float dotNVi = saturate( dot( normal, geometryViewDir ) );
	if ( material.iridescenceThickness == 0.0 ) {
		material.iridescence = 0.0;
	} else {
		material.iridescence = saturate( material.iridescence );
	}
	if ( material.iridescence > 0.0 ) {
		material.iridescenceFresnelDielectric = evalIridescence( 1.0, material.iridescenceIOR, dotNVi, material.iridescenceThickness, material.specularColor );
		material.iridescenceFresnelMetallic = evalIridescence( 1.0, material.iridescenceIOR, dotNVi, material.iridescenceThickness, material.diffuseColor );
		material.iridescenceFresnel = mix( material.iridescenceFresnelDielectric, material.iridescenceFresnelMetallic, material.metalness );
		material.iridescenceF0 = Schlick_to_F0( material.iridescenceFresnel, 1.0, dotNVi );
	}
#endif
IncidentLight directLight;
#if ( NUM_POINT_LIGHTS > 0 ) && defined( RE_Direct )
	PointLight pointLight;
	#if defined( USE_SHADOWMAP ) && NUM_POINT_LIGHT_SHADOWS > 0
	PointLightShadow pointLightShadow;
	#endif
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_POINT_LIGHTS; i ++ ) {
		pointLight = pointLights[ i ];
		getPointLightInfo( pointLight, geometryPosition, directLight );
		#if defined( USE_SHADOWMAP ) && ( UNROLLED_LOOP_INDEX < NUM_POINT_LIGHT_SHADOWS ) && ( defined( SHADOWMAP_TYPE_PCF ) || defined( SHADOWMAP_TYPE_BASIC ) )
		pointLightShadow = pointLightShadows[ i ];
		directLight.color *= ( directLight.visible && receiveShadow ) ? getPointShadow( pointShadowMap[ i ], pointLightShadow.shadowMapSize, pointLightShadow.shadowIntensity, pointLightShadow.shadowBias, pointLightShadow.shadowRadius, vPointShadowCoord[ i ], pointLightShadow.shadowCameraNear, pointLightShadow.shadowCameraFar ) : 1.0;
		#endif
		RE_Direct( directLight, geometryPosition, geometryNormal, geometryViewDir, geometryClearcoatNormal, material, reflectedLight );
	}
	#pragma unroll_loop_end
#endif
#if ( NUM_SPOT_LIGHTS > 0 ) && defined( RE_Direct )
	SpotLight spotLight;
	vec4 spotColor;
	vec3 spotLightCoord;
	bool inSpotLightMap;
	#if defined( USE_SHADOWMAP ) && NUM_SPOT_LIGHT_SHADOWS > 0
	SpotLightShadow spotLightShadow;
	#endif
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_SPOT_LIGHTS; i ++ ) {
		spotLight = spotLights[ i ];
		getSpotLightInfo( spotLight, geometryPosition, directLight );
		#if ( UNROLLED_LOOP_INDEX < NUM_SPOT_LIGHT_SHADOWS_WITH_MAPS )
		#define SPOT_LIGHT_MAP_INDEX UNROLLED_LOOP_INDEX
		#elif ( UNROLLED_LOOP_INDEX < NUM_SPOT_LIGHT_SHADOWS )
		#define SPOT_LIGHT_MAP_INDEX NUM_SPOT_LIGHT_MAPS
		#else
		#define SPOT_LIGHT_MAP_INDEX ( UNROLLED_LOOP_INDEX - NUM_SPOT_LIGHT_SHADOWS + NUM_SPOT_LIGHT_SHADOWS_WITH_MAPS )
		#endif
		#if ( SPOT_LIGHT_MAP_INDEX < NUM_SPOT_LIGHT_MAPS )
			spotLightCoord = vSpotLightCoord[ i ].xyz / vSpotLightCoord[ i ].w;
			inSpotLightMap = all( lessThan( abs( spotLightCoord * 2. - 1. ), vec3( 1.0 ) ) );
			spotColor = texture2D( spotLightMap[ SPOT_LIGHT_MAP_INDEX ], spotLightCoord.xy );
			directLight.color = inSpotLightMap ? directLight.color * spotColor.rgb : directLight.color;
		#endif
		#undef SPOT_LIGHT_MAP_INDEX
		#if defined( USE_SHADOWMAP ) && ( UNROLLED_LOOP_INDEX < NUM_SPOT_LIGHT_SHADOWS )
		spotLightShadow = spotLightShadows[ i ];
		directLight.color *= ( directLight.visible && receiveShadow ) ? getShadow( spotShadowMap[ i ], spotLightShadow.shadowMapSize, spotLightShadow.shadowIntensity, spotLightShadow.shadowBias, spotLightShadow.shadowRadius, vSpotLightCoord[ i ] ) : 1.0;
		#endif
		RE_Direct( directLight, geometryPosition, geometryNormal, geometryViewDir, geometryClearcoatNormal, material, reflectedLight );
	}
	#pragma unroll_loop_end
#endif
#if ( NUM_DIR_LIGHTS > 0 ) && defined( RE_Direct )
	DirectionalLight directionalLight;
	#if defined( USE_SHADOWMAP ) && NUM_DIR_LIGHT_SHADOWS > 0
	DirectionalLightShadow directionalLightShadow;
	#endif
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_DIR_LIGHTS; i ++ ) {
		directionalLight = directionalLights[ i ];
		getDirectionalLightInfo( directionalLight, directLight );
		#if defined( USE_SHADOWMAP ) && ( UNROLLED_LOOP_INDEX < NUM_DIR_LIGHT_SHADOWS )
		directionalLightShadow = directionalLightShadows[ i ];
		directLight.color *= ( directLight.visible && receiveShadow ) ? getShadow( directionalShadowMap[ i ], directionalLightShadow.shadowMapSize, directionalLightShadow.shadowIntensity, directionalLightShadow.shadowBias, directionalLightShadow.shadowRadius, vDirectionalShadowCoord[ i ] ) : 1.0;
		#endif
		RE_Direct( directLight, geometryPosition, geometryNormal, geometryViewDir, geometryClearcoatNormal, material, reflectedLight );
	}
	#pragma unroll_loop_end
#endif
#if ( NUM_RECT_AREA_LIGHTS > 0 ) && defined( RE_Direct_RectArea )
	RectAreaLight rectAreaLight;
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_RECT_AREA_LIGHTS; i ++ ) {
		rectAreaLight = rectAreaLights[ i ];
		RE_Direct_RectArea( rectAreaLight, geometryPosition, geometryNormal, geometryViewDir, geometryClearcoatNormal, material, reflectedLight );
	}
	#pragma unroll_loop_end
#endif
#if defined( RE_IndirectDiffuse )
	vec3 iblIrradiance = vec3( 0.0 );
	vec3 irradiance = getAmbientLightIrradiance( ambientLightColor );
	#if defined( USE_LIGHT_PROBES )
		irradiance += getLightProbeIrradiance( lightProbe, geometryNormal );
	#endif
	#if ( NUM_HEMI_LIGHTS > 0 )
		#pragma unroll_loop_start
		for ( int i = 0; i < NUM_HEMI_LIGHTS; i ++ ) {
			irradiance += getHemisphereLightIrradiance( hemisphereLights[ i ], geometryNormal );
		}
		#pragma unroll_loop_end
	#endif
	#ifdef USE_LIGHT_PROBES_GRID
		vec3 probeWorldPos = ( ( vec4( geometryPosition, 1.0 ) - viewMatrix[ 3 ] ) * viewMatrix ).xyz;
		vec3 probeWorldNormal = inverseTransformDirection( geometryNormal, viewMatrix );
		irradiance += getLightProbeGridIrradiance( probeWorldPos, probeWorldNormal );
	#endif
#endif
#if defined( RE_IndirectSpecular )
	vec3 radiance = vec3( 0.0 );
	vec3 clearcoatRadiance = vec3( 0.0 );
#endif`,lights_fragment_maps:`#if defined( RE_IndirectDiffuse )
	#ifdef USE_LIGHTMAP
		vec4 lightMapTexel = texture2D( lightMap, vLightMapUv );
		vec3 lightMapIrradiance = lightMapTexel.rgb * lightMapIntensity;
		irradiance += lightMapIrradiance;
	#endif
	#if defined( USE_ENVMAP ) && defined( ENVMAP_TYPE_CUBE_UV )
		#if defined( STANDARD ) || defined( LAMBERT ) || defined( PHONG )
			iblIrradiance += getIBLIrradiance( geometryNormal );
		#endif
	#endif
#endif
#if defined( USE_ENVMAP ) && defined( RE_IndirectSpecular )
	#ifdef USE_ANISOTROPY
		radiance += getIBLAnisotropyRadiance( geometryViewDir, geometryNormal, material.roughness, material.anisotropyB, material.anisotropy );
	#else
		radiance += getIBLRadiance( geometryViewDir, geometryNormal, material.roughness );
	#endif
	#ifdef USE_CLEARCOAT
		clearcoatRadiance += getIBLRadiance( geometryViewDir, geometryClearcoatNormal, material.clearcoatRoughness );
	#endif
#endif`,lights_fragment_end:`#if defined( RE_IndirectDiffuse )
	#if defined( LAMBERT ) || defined( PHONG )
		irradiance += iblIrradiance;
	#endif
	RE_IndirectDiffuse( irradiance, geometryPosition, geometryNormal, geometryViewDir, geometryClearcoatNormal, material, reflectedLight );
#endif
#if defined( RE_IndirectSpecular )
	RE_IndirectSpecular( radiance, iblIrradiance, clearcoatRadiance, geometryPosition, geometryNormal, geometryViewDir, geometryClearcoatNormal, material, reflectedLight );
#endif`,lightprobes_pars_fragment:`#ifdef USE_LIGHT_PROBES_GRID
uniform highp sampler3D probesSH;
uniform vec3 probesMin;
uniform vec3 probesMax;
uniform vec3 probesResolution;
vec3 getLightProbeGridIrradiance( vec3 worldPos, vec3 worldNormal ) {
	vec3 res = probesResolution;
	vec3 gridRange = probesMax - probesMin;
	vec3 resMinusOne = res - 1.0;
	vec3 probeSpacing = gridRange / resMinusOne;
	vec3 samplePos = worldPos + worldNormal * probeSpacing * 0.5;
	vec3 uvw = clamp( ( samplePos - probesMin ) / gridRange, 0.0, 1.0 );
	uvw = uvw * resMinusOne / res + 0.5 / res;
	float nz          = res.z;
	float paddedSlices = nz + 2.0;
	float atlasDepth  = 7.0 * paddedSlices;
	float uvZBase     = uvw.z * nz + 1.0;
	vec4 s0 = texture( probesSH, vec3( uvw.xy, ( uvZBase                       ) / atlasDepth ) );
	vec4 s1 = texture( probesSH, vec3( uvw.xy, ( uvZBase +       paddedSlices   ) / atlasDepth ) );
	vec4 s2 = texture( probesSH, vec3( uvw.xy, ( uvZBase + 2.0 * paddedSlices   ) / atlasDepth ) );
	vec4 s3 = texture( probesSH, vec3( uvw.xy, ( uvZBase + 3.0 * paddedSlices   ) / atlasDepth ) );
	vec4 s4 = texture( probesSH, vec3( uvw.xy, ( uvZBase + 4.0 * paddedSlices   ) / atlasDepth ) );
	vec4 s5 = texture( probesSH, vec3( uvw.xy, ( uvZBase + 5.0 * paddedSlices   ) / atlasDepth ) );
	vec4 s6 = texture( probesSH, vec3( uvw.xy, ( uvZBase + 6.0 * paddedSlices   ) / atlasDepth ) );
	vec3 c0 = s0.xyz;
	vec3 c1 = vec3( s0.w, s1.xy );
	vec3 c2 = vec3( s1.zw, s2.x );
	vec3 c3 = s2.yzw;
	vec3 c4 = s3.xyz;
	vec3 c5 = vec3( s3.w, s4.xy );
	vec3 c6 = vec3( s4.zw, s5.x );
	vec3 c7 = s5.yzw;
	vec3 c8 = s6.xyz;
	float x = worldNormal.x, y = worldNormal.y, z = worldNormal.z;
	vec3 result = c0 * 0.886227;
	result += c1 * 2.0 * 0.511664 * y;
	result += c2 * 2.0 * 0.511664 * z;
	result += c3 * 2.0 * 0.511664 * x;
	result += c4 * 2.0 * 0.429043 * x * y;
	result += c5 * 2.0 * 0.429043 * y * z;
	result += c6 * ( 0.743125 * z * z - 0.247708 );
	result += c7 * 2.0 * 0.429043 * x * z;
	result += c8 * 0.429043 * ( x * x - y * y );
	return max( result, vec3( 0.0 ) );
}
#endif`,logdepthbuf_fragment:`#if defined( USE_LOGARITHMIC_DEPTH_BUFFER )
	gl_FragDepth = vIsPerspective == 0.0 ? gl_FragCoord.z : log2( vFragDepth ) * logDepthBufFC * 0.5;
#endif`,logdepthbuf_pars_fragment:`#if defined( USE_LOGARITHMIC_DEPTH_BUFFER )
	uniform float logDepthBufFC;
	varying float vFragDepth;
	varying float vIsPerspective;
#endif`,logdepthbuf_pars_vertex:`#ifdef USE_LOGARITHMIC_DEPTH_BUFFER
	varying float vFragDepth;
	varying float vIsPerspective;
#endif`,logdepthbuf_vertex:`#ifdef USE_LOGARITHMIC_DEPTH_BUFFER
	vFragDepth = 1.0 + gl_Position.w;
	vIsPerspective = float( isPerspectiveMatrix( projectionMatrix ) );
#endif`,map_fragment:`#ifdef USE_MAP
	vec4 sampledDiffuseColor = texture2D( map, vMapUv );
	#ifdef DECODE_VIDEO_TEXTURE
		sampledDiffuseColor = sRGBTransferEOTF( sampledDiffuseColor );
	#endif
	diffuseColor *= sampledDiffuseColor;
#endif`,map_pars_fragment:`#ifdef USE_MAP
	uniform sampler2D map;
#endif`,map_particle_fragment:`#if defined( USE_MAP ) || defined( USE_ALPHAMAP )
	#if defined( USE_POINTS_UV )
		vec2 uv = vUv;
	#else
		vec2 uv = ( uvTransform * vec3( gl_PointCoord.x, 1.0 - gl_PointCoord.y, 1 ) ).xy;
	#endif
#endif
#ifdef USE_MAP
	diffuseColor *= texture2D( map, uv );
#endif
#ifdef USE_ALPHAMAP
	diffuseColor.a *= texture2D( alphaMap, uv ).g;
#endif`,map_particle_pars_fragment:`#if defined( USE_POINTS_UV )
	varying vec2 vUv;
#else
	#if defined( USE_MAP ) || defined( USE_ALPHAMAP )
		uniform mat3 uvTransform;
	#endif
#endif
#ifdef USE_MAP
	uniform sampler2D map;
#endif
#ifdef USE_ALPHAMAP
	uniform sampler2D alphaMap;
#endif`,metalnessmap_fragment:`float metalnessFactor = metalness;
#ifdef USE_METALNESSMAP
	vec4 texelMetalness = texture2D( metalnessMap, vMetalnessMapUv );
	metalnessFactor *= texelMetalness.b;
#endif`,metalnessmap_pars_fragment:`#ifdef USE_METALNESSMAP
	uniform sampler2D metalnessMap;
#endif`,morphinstance_vertex:`#ifdef USE_INSTANCING_MORPH
	float morphTargetInfluences[ MORPHTARGETS_COUNT ];
	float morphTargetBaseInfluence = texelFetch( morphTexture, ivec2( 0, gl_InstanceID ), 0 ).r;
	for ( int i = 0; i < MORPHTARGETS_COUNT; i ++ ) {
		morphTargetInfluences[i] =  texelFetch( morphTexture, ivec2( i + 1, gl_InstanceID ), 0 ).r;
	}
#endif`,morphcolor_vertex:`#if defined( USE_MORPHCOLORS )
	vColor *= morphTargetBaseInfluence;
	for ( int i = 0; i < MORPHTARGETS_COUNT; i ++ ) {
		#if defined( USE_COLOR_ALPHA )
			if ( morphTargetInfluences[ i ] != 0.0 ) vColor += getMorph( gl_VertexID, i, 2 ) * morphTargetInfluences[ i ];
		#elif defined( USE_COLOR )
			if ( morphTargetInfluences[ i ] != 0.0 ) vColor += getMorph( gl_VertexID, i, 2 ).rgb * morphTargetInfluences[ i ];
		#endif
	}
#endif`,morphnormal_vertex:`#ifdef USE_MORPHNORMALS
	objectNormal *= morphTargetBaseInfluence;
	for ( int i = 0; i < MORPHTARGETS_COUNT; i ++ ) {
		if ( morphTargetInfluences[ i ] != 0.0 ) objectNormal += getMorph( gl_VertexID, i, 1 ).xyz * morphTargetInfluences[ i ];
	}
#endif`,morphtarget_pars_vertex:`#ifdef USE_MORPHTARGETS
	#ifndef USE_INSTANCING_MORPH
		uniform float morphTargetBaseInfluence;
		uniform float morphTargetInfluences[ MORPHTARGETS_COUNT ];
	#endif
	uniform sampler2DArray morphTargetsTexture;
	uniform ivec2 morphTargetsTextureSize;
	vec4 getMorph( const in int vertexIndex, const in int morphTargetIndex, const in int offset ) {
		int texelIndex = vertexIndex * MORPHTARGETS_TEXTURE_STRIDE + offset;
		int y = texelIndex / morphTargetsTextureSize.x;
		int x = texelIndex - y * morphTargetsTextureSize.x;
		ivec3 morphUV = ivec3( x, y, morphTargetIndex );
		return texelFetch( morphTargetsTexture, morphUV, 0 );
	}
#endif`,morphtarget_vertex:`#ifdef USE_MORPHTARGETS
	transformed *= morphTargetBaseInfluence;
	for ( int i = 0; i < MORPHTARGETS_COUNT; i ++ ) {
		if ( morphTargetInfluences[ i ] != 0.0 ) transformed += getMorph( gl_VertexID, i, 0 ).xyz * morphTargetInfluences[ i ];
	}
#endif`,normal_fragment_begin:`float faceDirection = gl_FrontFacing ? 1.0 : - 1.0;
#ifdef FLAT_SHADED
	vec3 fdx = dFdx( vViewPosition );
	vec3 fdy = dFdy( vViewPosition );
	vec3 normal = normalize( cross( fdx, fdy ) );
#else
	vec3 normal = normalize( vNormal );
	#ifdef DOUBLE_SIDED
		normal *= faceDirection;
	#endif
#endif
#if defined( USE_NORMALMAP_TANGENTSPACE ) || defined( USE_CLEARCOAT_NORMALMAP ) || defined( USE_ANISOTROPY )
	#ifdef USE_TANGENT
		mat3 tbn = mat3( normalize( vTangent ), normalize( vBitangent ), normal );
	#else
		mat3 tbn = getTangentFrame( - vViewPosition, normal,
		#if defined( USE_NORMALMAP )
			vNormalMapUv
		#elif defined( USE_CLEARCOAT_NORMALMAP )
			vClearcoatNormalMapUv
		#else
			vUv
		#endif
		);
	#endif
	#if defined( DOUBLE_SIDED ) && ! defined( FLAT_SHADED )
		tbn[0] *= faceDirection;
		tbn[1] *= faceDirection;
	#endif
#endif
#ifdef USE_CLEARCOAT_NORMALMAP
	#ifdef USE_TANGENT
		mat3 tbn2 = mat3( normalize( vTangent ), normalize( vBitangent ), normal );
	#else
		mat3 tbn2 = getTangentFrame( - vViewPosition, normal, vClearcoatNormalMapUv );
	#endif
	#if defined( DOUBLE_SIDED ) && ! defined( FLAT_SHADED )
		tbn2[0] *= faceDirection;
		tbn2[1] *= faceDirection;
	#endif
#endif
vec3 nonPerturbedNormal = normal;`,normal_fragment_maps:`#ifdef USE_NORMALMAP_OBJECTSPACE
	normal = texture2D( normalMap, vNormalMapUv ).xyz * 2.0 - 1.0;
	#ifdef FLIP_SIDED
		normal = - normal;
	#endif
	#ifdef DOUBLE_SIDED
		normal = normal * faceDirection;
	#endif
	normal = normalize( normalMatrix * normal );
#elif defined( USE_NORMALMAP_TANGENTSPACE )
	vec3 mapN = texture2D( normalMap, vNormalMapUv ).xyz * 2.0 - 1.0;
	#if defined( USE_PACKED_NORMALMAP )
		mapN = vec3( mapN.xy, sqrt( saturate( 1.0 - dot( mapN.xy, mapN.xy ) ) ) );
	#endif
	mapN.xy *= normalScale;
	normal = normalize( tbn * mapN );
#elif defined( USE_BUMPMAP )
	normal = perturbNormalArb( - vViewPosition, normal, dHdxy_fwd(), faceDirection );
#endif`,normal_pars_fragment:`#ifndef FLAT_SHADED
	varying vec3 vNormal;
	#ifdef USE_TANGENT
		varying vec3 vTangent;
		varying vec3 vBitangent;
	#endif
#endif`,normal_pars_vertex:`#ifndef FLAT_SHADED
	varying vec3 vNormal;
	#ifdef USE_TANGENT
		varying vec3 vTangent;
		varying vec3 vBitangent;
	#endif
#endif`,normal_vertex:`#ifndef FLAT_SHADED
	vNormal = normalize( transformedNormal );
	#ifdef USE_TANGENT
		vTangent = normalize( transformedTangent );
		vBitangent = normalize( cross( vNormal, vTangent ) * tangent.w );
	#endif
#endif`,normalmap_pars_fragment:`#ifdef USE_NORMALMAP
	uniform sampler2D normalMap;
	uniform vec2 normalScale;
#endif
#ifdef USE_NORMALMAP_OBJECTSPACE
	uniform mat3 normalMatrix;
#endif
#if ! defined ( USE_TANGENT ) && ( defined ( USE_NORMALMAP_TANGENTSPACE ) || defined ( USE_CLEARCOAT_NORMALMAP ) || defined( USE_ANISOTROPY ) )
	mat3 getTangentFrame( vec3 eye_pos, vec3 surf_norm, vec2 uv ) {
		vec3 q0 = dFdx( eye_pos.xyz );
		vec3 q1 = dFdy( eye_pos.xyz );
		vec2 st0 = dFdx( uv.st );
		vec2 st1 = dFdy( uv.st );
		vec3 N = surf_norm;
		vec3 q1perp = cross( q1, N );
		vec3 q0perp = cross( N, q0 );
		vec3 T = q1perp * st0.x + q0perp * st1.x;
		vec3 B = q1perp * st0.y + q0perp * st1.y;
		float det = max( dot( T, T ), dot( B, B ) );
		float scale = ( det == 0.0 ) ? 0.0 : inversesqrt( det );
		return mat3( T * scale, B * scale, N );
	}
#endif`,clearcoat_normal_fragment_begin:`#ifdef USE_CLEARCOAT
	vec3 clearcoatNormal = nonPerturbedNormal;
#endif`,clearcoat_normal_fragment_maps:`#ifdef USE_CLEARCOAT_NORMALMAP
	vec3 clearcoatMapN = texture2D( clearcoatNormalMap, vClearcoatNormalMapUv ).xyz * 2.0 - 1.0;
	clearcoatMapN.xy *= clearcoatNormalScale;
	clearcoatNormal = normalize( tbn2 * clearcoatMapN );
#endif`,clearcoat_pars_fragment:`#ifdef USE_CLEARCOATMAP
	uniform sampler2D clearcoatMap;
#endif
#ifdef USE_CLEARCOAT_NORMALMAP
	uniform sampler2D clearcoatNormalMap;
	uniform vec2 clearcoatNormalScale;
#endif
#ifdef USE_CLEARCOAT_ROUGHNESSMAP
	uniform sampler2D clearcoatRoughnessMap;
#endif`,iridescence_pars_fragment:`#ifdef USE_IRIDESCENCEMAP
	uniform sampler2D iridescenceMap;
#endif
#ifdef USE_IRIDESCENCE_THICKNESSMAP
	uniform sampler2D iridescenceThicknessMap;
#endif`,opaque_fragment:`#ifdef OPAQUE
diffuseColor.a = 1.0;
#endif
#ifdef USE_TRANSMISSION
diffuseColor.a *= material.transmissionAlpha;
#endif
gl_FragColor = vec4( outgoingLight, diffuseColor.a );`,packing:`vec3 packNormalToRGB( const in vec3 normal ) {
	return normalize( normal ) * 0.5 + 0.5;
}
vec3 unpackRGBToNormal( const in vec3 rgb ) {
	return 2.0 * rgb.xyz - 1.0;
}
const float PackUpscale = 256. / 255.;const float UnpackDownscale = 255. / 256.;const float ShiftRight8 = 1. / 256.;
const float Inv255 = 1. / 255.;
const vec4 PackFactors = vec4( 1.0, 256.0, 256.0 * 256.0, 256.0 * 256.0 * 256.0 );
const vec2 UnpackFactors2 = vec2( UnpackDownscale, 1.0 / PackFactors.g );
const vec3 UnpackFactors3 = vec3( UnpackDownscale / PackFactors.rg, 1.0 / PackFactors.b );
const vec4 UnpackFactors4 = vec4( UnpackDownscale / PackFactors.rgb, 1.0 / PackFactors.a );
vec4 packDepthToRGBA( const in float v ) {
	if( v <= 0.0 )
		return vec4( 0., 0., 0., 0. );
	if( v >= 1.0 )
		return vec4( 1., 1., 1., 1. );
	float vuf;
	float af = modf( v * PackFactors.a, vuf );
	float bf = modf( vuf * ShiftRight8, vuf );
	float gf = modf( vuf * ShiftRight8, vuf );
	return vec4( vuf * Inv255, gf * PackUpscale, bf * PackUpscale, af );
}
vec3 packDepthToRGB( const in float v ) {
	if( v <= 0.0 )
		return vec3( 0., 0., 0. );
	if( v >= 1.0 )
		return vec3( 1., 1., 1. );
	float vuf;
	float bf = modf( v * PackFactors.b, vuf );
	float gf = modf( vuf * ShiftRight8, vuf );
	return vec3( vuf * Inv255, gf * PackUpscale, bf );
}
vec2 packDepthToRG( const in float v ) {
	if( v <= 0.0 )
		return vec2( 0., 0. );
	if( v >= 1.0 )
		return vec2( 1., 1. );
	float vuf;
	float gf = modf( v * 256., vuf );
	return vec2( vuf * Inv255, gf );
}
float unpackRGBAToDepth( const in vec4 v ) {
	return dot( v, UnpackFactors4 );
}
float unpackRGBToDepth( const in vec3 v ) {
	return dot( v, UnpackFactors3 );
}
float unpackRGToDepth( const in vec2 v ) {
	return v.r * UnpackFactors2.r + v.g * UnpackFactors2.g;
}
vec4 pack2HalfToRGBA( const in vec2 v ) {
	vec4 r = vec4( v.x, fract( v.x * 255.0 ), v.y, fract( v.y * 255.0 ) );
	return vec4( r.x - r.y / 255.0, r.y, r.z - r.w / 255.0, r.w );
}
vec2 unpackRGBATo2Half( const in vec4 v ) {
	return vec2( v.x + ( v.y / 255.0 ), v.z + ( v.w / 255.0 ) );
}
float viewZToOrthographicDepth( const in float viewZ, const in float near, const in float far ) {
	return ( viewZ + near ) / ( near - far );
}
float orthographicDepthToViewZ( const in float depth, const in float near, const in float far ) {
	#ifdef USE_REVERSED_DEPTH_BUFFER
	
		return depth * ( far - near ) - far;
	#else
		return depth * ( near - far ) - near;
	#endif
}
float viewZToPerspectiveDepth( const in float viewZ, const in float near, const in float far ) {
	return ( ( near + viewZ ) * far ) / ( ( far - near ) * viewZ );
}
float perspectiveDepthToViewZ( const in float depth, const in float near, const in float far ) {
	
	#ifdef USE_REVERSED_DEPTH_BUFFER
		return ( near * far ) / ( ( near - far ) * depth - near );
	#else
		return ( near * far ) / ( ( far - near ) * depth - far );
	#endif
}`,premultiplied_alpha_fragment:`#ifdef PREMULTIPLIED_ALPHA
	gl_FragColor.rgb *= gl_FragColor.a;
#endif`,project_vertex:`vec4 mvPosition = vec4( transformed, 1.0 );
#ifdef USE_BATCHING
	mvPosition = batchingMatrix * mvPosition;
#endif
#ifdef USE_INSTANCING
	mvPosition = instanceMatrix * mvPosition;
#endif
mvPosition = modelViewMatrix * mvPosition;
gl_Position = projectionMatrix * mvPosition;`,dithering_fragment:`#ifdef DITHERING
	gl_FragColor.rgb = dithering( gl_FragColor.rgb );
#endif`,dithering_pars_fragment:`#ifdef DITHERING
	vec3 dithering( vec3 color ) {
		float grid_position = rand( gl_FragCoord.xy );
		vec3 dither_shift_RGB = vec3( 0.25 / 255.0, -0.25 / 255.0, 0.25 / 255.0 );
		dither_shift_RGB = mix( 2.0 * dither_shift_RGB, -2.0 * dither_shift_RGB, grid_position );
		return color + dither_shift_RGB;
	}
#endif`,roughnessmap_fragment:`float roughnessFactor = roughness;
#ifdef USE_ROUGHNESSMAP
	vec4 texelRoughness = texture2D( roughnessMap, vRoughnessMapUv );
	roughnessFactor *= texelRoughness.g;
#endif`,roughnessmap_pars_fragment:`#ifdef USE_ROUGHNESSMAP
	uniform sampler2D roughnessMap;
#endif`,shadowmap_pars_fragment:`#if NUM_SPOT_LIGHT_COORDS > 0
	varying vec4 vSpotLightCoord[ NUM_SPOT_LIGHT_COORDS ];
#endif
#if NUM_SPOT_LIGHT_MAPS > 0
	uniform sampler2D spotLightMap[ NUM_SPOT_LIGHT_MAPS ];
#endif
#ifdef USE_SHADOWMAP
	#if NUM_DIR_LIGHT_SHADOWS > 0
		#if defined( SHADOWMAP_TYPE_PCF )
			uniform sampler2DShadow directionalShadowMap[ NUM_DIR_LIGHT_SHADOWS ];
		#else
			uniform sampler2D directionalShadowMap[ NUM_DIR_LIGHT_SHADOWS ];
		#endif
		varying vec4 vDirectionalShadowCoord[ NUM_DIR_LIGHT_SHADOWS ];
		struct DirectionalLightShadow {
			float shadowIntensity;
			float shadowBias;
			float shadowNormalBias;
			float shadowRadius;
			vec2 shadowMapSize;
		};
		uniform DirectionalLightShadow directionalLightShadows[ NUM_DIR_LIGHT_SHADOWS ];
	#endif
	#if NUM_SPOT_LIGHT_SHADOWS > 0
		#if defined( SHADOWMAP_TYPE_PCF )
			uniform sampler2DShadow spotShadowMap[ NUM_SPOT_LIGHT_SHADOWS ];
		#else
			uniform sampler2D spotShadowMap[ NUM_SPOT_LIGHT_SHADOWS ];
		#endif
		struct SpotLightShadow {
			float shadowIntensity;
			float shadowBias;
			float shadowNormalBias;
			float shadowRadius;
			vec2 shadowMapSize;
		};
		uniform SpotLightShadow spotLightShadows[ NUM_SPOT_LIGHT_SHADOWS ];
	#endif
	#if NUM_POINT_LIGHT_SHADOWS > 0
		#if defined( SHADOWMAP_TYPE_PCF )
			uniform samplerCubeShadow pointShadowMap[ NUM_POINT_LIGHT_SHADOWS ];
		#elif defined( SHADOWMAP_TYPE_BASIC )
			uniform samplerCube pointShadowMap[ NUM_POINT_LIGHT_SHADOWS ];
		#endif
		varying vec4 vPointShadowCoord[ NUM_POINT_LIGHT_SHADOWS ];
		struct PointLightShadow {
			float shadowIntensity;
			float shadowBias;
			float shadowNormalBias;
			float shadowRadius;
			vec2 shadowMapSize;
			float shadowCameraNear;
			float shadowCameraFar;
		};
		uniform PointLightShadow pointLightShadows[ NUM_POINT_LIGHT_SHADOWS ];
	#endif
	#if defined( SHADOWMAP_TYPE_PCF )
		float interleavedGradientNoise( vec2 position ) {
			return fract( 52.9829189 * fract( dot( position, vec2( 0.06711056, 0.00583715 ) ) ) );
		}
		vec2 vogelDiskSample( int sampleIndex, int samplesCount, float phi ) {
			const float goldenAngle = 2.399963229728653;
			float r = sqrt( ( float( sampleIndex ) + 0.5 ) / float( samplesCount ) );
			float theta = float( sampleIndex ) * goldenAngle + phi;
			return vec2( cos( theta ), sin( theta ) ) * r;
		}
	#endif
	#if defined( SHADOWMAP_TYPE_PCF )
		float getShadow( sampler2DShadow shadowMap, vec2 shadowMapSize, float shadowIntensity, float shadowBias, float shadowRadius, vec4 shadowCoord ) {
			float shadow = 1.0;
			shadowCoord.xyz /= shadowCoord.w;
			shadowCoord.z += shadowBias;
			bool inFrustum = shadowCoord.x >= 0.0 && shadowCoord.x <= 1.0 && shadowCoord.y >= 0.0 && shadowCoord.y <= 1.0;
			bool frustumTest = inFrustum && shadowCoord.z <= 1.0;
			if ( frustumTest ) {
				vec2 texelSize = vec2( 1.0 ) / shadowMapSize;
				float radius = shadowRadius * texelSize.x;
				float phi = interleavedGradientNoise( gl_FragCoord.xy ) * PI2;
				shadow = (
					texture( shadowMap, vec3( shadowCoord.xy + vogelDiskSample( 0, 5, phi ) * radius, shadowCoord.z ) ) +
					texture( shadowMap, vec3( shadowCoord.xy + vogelDiskSample( 1, 5, phi ) * radius, shadowCoord.z ) ) +
					texture( shadowMap, vec3( shadowCoord.xy + vogelDiskSample( 2, 5, phi ) * radius, shadowCoord.z ) ) +
					texture( shadowMap, vec3( shadowCoord.xy + vogelDiskSample( 3, 5, phi ) * radius, shadowCoord.z ) ) +
					texture( shadowMap, vec3( shadowCoord.xy + vogelDiskSample( 4, 5, phi ) * radius, shadowCoord.z ) )
				) * 0.2;
			}
			return mix( 1.0, shadow, shadowIntensity );
		}
	#elif defined( SHADOWMAP_TYPE_VSM )
		float getShadow( sampler2D shadowMap, vec2 shadowMapSize, float shadowIntensity, float shadowBias, float shadowRadius, vec4 shadowCoord ) {
			float shadow = 1.0;
			shadowCoord.xyz /= shadowCoord.w;
			#ifdef USE_REVERSED_DEPTH_BUFFER
				shadowCoord.z -= shadowBias;
			#else
				shadowCoord.z += shadowBias;
			#endif
			bool inFrustum = shadowCoord.x >= 0.0 && shadowCoord.x <= 1.0 && shadowCoord.y >= 0.0 && shadowCoord.y <= 1.0;
			bool frustumTest = inFrustum && shadowCoord.z <= 1.0;
			if ( frustumTest ) {
				vec2 distribution = texture2D( shadowMap, shadowCoord.xy ).rg;
				float mean = distribution.x;
				float variance = distribution.y * distribution.y;
				#ifdef USE_REVERSED_DEPTH_BUFFER
					float hard_shadow = step( mean, shadowCoord.z );
				#else
					float hard_shadow = step( shadowCoord.z, mean );
				#endif
				
				if ( hard_shadow == 1.0 ) {
					shadow = 1.0;
				} else {
					variance = max( variance, 0.0000001 );
					float d = shadowCoord.z - mean;
					float p_max = variance / ( variance + d * d );
					p_max = clamp( ( p_max - 0.3 ) / 0.65, 0.0, 1.0 );
					shadow = max( hard_shadow, p_max );
				}
			}
			return mix( 1.0, shadow, shadowIntensity );
		}
	#else
		float getShadow( sampler2D shadowMap, vec2 shadowMapSize, float shadowIntensity, float shadowBias, float shadowRadius, vec4 shadowCoord ) {
			float shadow = 1.0;
			shadowCoord.xyz /= shadowCoord.w;
			#ifdef USE_REVERSED_DEPTH_BUFFER
				shadowCoord.z -= shadowBias;
			#else
				shadowCoord.z += shadowBias;
			#endif
			bool inFrustum = shadowCoord.x >= 0.0 && shadowCoord.x <= 1.0 && shadowCoord.y >= 0.0 && shadowCoord.y <= 1.0;
			bool frustumTest = inFrustum && shadowCoord.z <= 1.0;
			if ( frustumTest ) {
				float depth = texture2D( shadowMap, shadowCoord.xy ).r;
				#ifdef USE_REVERSED_DEPTH_BUFFER
					shadow = step( depth, shadowCoord.z );
				#else
					shadow = step( shadowCoord.z, depth );
				#endif
			}
			return mix( 1.0, shadow, shadowIntensity );
		}
	#endif
	#if NUM_POINT_LIGHT_SHADOWS > 0
	#if defined( SHADOWMAP_TYPE_PCF )
	float getPointShadow( samplerCubeShadow shadowMap, vec2 shadowMapSize, float shadowIntensity, float shadowBias, float shadowRadius, vec4 shadowCoord, float shadowCameraNear, float shadowCameraFar ) {
		float shadow = 1.0;
		vec3 lightToPosition = shadowCoord.xyz;
		vec3 bd3D = normalize( lightToPosition );
		vec3 absVec = abs( lightToPosition );
		float viewSpaceZ = max( max( absVec.x, absVec.y ), absVec.z );
		if ( viewSpaceZ - shadowCameraFar <= 0.0 && viewSpaceZ - shadowCameraNear >= 0.0 ) {
			#ifdef USE_REVERSED_DEPTH_BUFFER
				float dp = ( shadowCameraNear * ( shadowCameraFar - viewSpaceZ ) ) / ( viewSpaceZ * ( shadowCameraFar - shadowCameraNear ) );
				dp -= shadowBias;
			#else
				float dp = ( shadowCameraFar * ( viewSpaceZ - shadowCameraNear ) ) / ( viewSpaceZ * ( shadowCameraFar - shadowCameraNear ) );
				dp += shadowBias;
			#endif
			float texelSize = shadowRadius / shadowMapSize.x;
			vec3 absDir = abs( bd3D );
			vec3 tangent = absDir.x > absDir.z ? vec3( 0.0, 1.0, 0.0 ) : vec3( 1.0, 0.0, 0.0 );
			tangent = normalize( cross( bd3D, tangent ) );
			vec3 bitangent = cross( bd3D, tangent );
			float phi = interleavedGradientNoise( gl_FragCoord.xy ) * PI2;
			vec2 sample0 = vogelDiskSample( 0, 5, phi );
			vec2 sample1 = vogelDiskSample( 1, 5, phi );
			vec2 sample2 = vogelDiskSample( 2, 5, phi );
			vec2 sample3 = vogelDiskSample( 3, 5, phi );
			vec2 sample4 = vogelDiskSample( 4, 5, phi );
			shadow = (
				texture( shadowMap, vec4( bd3D + ( tangent * sample0.x + bitangent * sample0.y ) * texelSize, dp ) ) +
				texture( shadowMap, vec4( bd3D + ( tangent * sample1.x + bitangent * sample1.y ) * texelSize, dp ) ) +
				texture( shadowMap, vec4( bd3D + ( tangent * sample2.x + bitangent * sample2.y ) * texelSize, dp ) ) +
				texture( shadowMap, vec4( bd3D + ( tangent * sample3.x + bitangent * sample3.y ) * texelSize, dp ) ) +
				texture( shadowMap, vec4( bd3D + ( tangent * sample4.x + bitangent * sample4.y ) * texelSize, dp ) )
			) * 0.2;
		}
		return mix( 1.0, shadow, shadowIntensity );
	}
	#elif defined( SHADOWMAP_TYPE_BASIC )
	float getPointShadow( samplerCube shadowMap, vec2 shadowMapSize, float shadowIntensity, float shadowBias, float shadowRadius, vec4 shadowCoord, float shadowCameraNear, float shadowCameraFar ) {
		float shadow = 1.0;
		vec3 lightToPosition = shadowCoord.xyz;
		vec3 absVec = abs( lightToPosition );
		float viewSpaceZ = max( max( absVec.x, absVec.y ), absVec.z );
		if ( viewSpaceZ - shadowCameraFar <= 0.0 && viewSpaceZ - shadowCameraNear >= 0.0 ) {
			float dp = ( shadowCameraFar * ( viewSpaceZ - shadowCameraNear ) ) / ( viewSpaceZ * ( shadowCameraFar - shadowCameraNear ) );
			dp += shadowBias;
			vec3 bd3D = normalize( lightToPosition );
			float depth = textureCube( shadowMap, bd3D ).r;
			#ifdef USE_REVERSED_DEPTH_BUFFER
				depth = 1.0 - depth;
			#endif
			shadow = step( dp, depth );
		}
		return mix( 1.0, shadow, shadowIntensity );
	}
	#endif
	#endif
#endif`,shadowmap_pars_vertex:`#if NUM_SPOT_LIGHT_COORDS > 0
	uniform mat4 spotLightMatrix[ NUM_SPOT_LIGHT_COORDS ];
	varying vec4 vSpotLightCoord[ NUM_SPOT_LIGHT_COORDS ];
#endif
#ifdef USE_SHADOWMAP
	#if NUM_DIR_LIGHT_SHADOWS > 0
		uniform mat4 directionalShadowMatrix[ NUM_DIR_LIGHT_SHADOWS ];
		varying vec4 vDirectionalShadowCoord[ NUM_DIR_LIGHT_SHADOWS ];
		struct DirectionalLightShadow {
			float shadowIntensity;
			float shadowBias;
			float shadowNormalBias;
			float shadowRadius;
			vec2 shadowMapSize;
		};
		uniform DirectionalLightShadow directionalLightShadows[ NUM_DIR_LIGHT_SHADOWS ];
	#endif
	#if NUM_SPOT_LIGHT_SHADOWS > 0
		struct SpotLightShadow {
			float shadowIntensity;
			float shadowBias;
			float shadowNormalBias;
			float shadowRadius;
			vec2 shadowMapSize;
		};
		uniform SpotLightShadow spotLightShadows[ NUM_SPOT_LIGHT_SHADOWS ];
	#endif
	#if NUM_POINT_LIGHT_SHADOWS > 0
		uniform mat4 pointShadowMatrix[ NUM_POINT_LIGHT_SHADOWS ];
		varying vec4 vPointShadowCoord[ NUM_POINT_LIGHT_SHADOWS ];
		struct PointLightShadow {
			float shadowIntensity;
			float shadowBias;
			float shadowNormalBias;
			float shadowRadius;
			vec2 shadowMapSize;
			float shadowCameraNear;
			float shadowCameraFar;
		};
		uniform PointLightShadow pointLightShadows[ NUM_POINT_LIGHT_SHADOWS ];
	#endif
#endif`,shadowmap_vertex:`#if ( defined( USE_SHADOWMAP ) && ( NUM_DIR_LIGHT_SHADOWS > 0 || NUM_POINT_LIGHT_SHADOWS > 0 ) ) || ( NUM_SPOT_LIGHT_COORDS > 0 )
	#ifdef HAS_NORMAL
		vec3 shadowWorldNormal = inverseTransformDirection( transformedNormal, viewMatrix );
	#else
		vec3 shadowWorldNormal = vec3( 0.0 );
	#endif
	vec4 shadowWorldPosition;
#endif
#if defined( USE_SHADOWMAP )
	#if NUM_DIR_LIGHT_SHADOWS > 0
		#pragma unroll_loop_start
		for ( int i = 0; i < NUM_DIR_LIGHT_SHADOWS; i ++ ) {
			shadowWorldPosition = worldPosition + vec4( shadowWorldNormal * directionalLightShadows[ i ].shadowNormalBias, 0 );
			vDirectionalShadowCoord[ i ] = directionalShadowMatrix[ i ] * shadowWorldPosition;
		}
		#pragma unroll_loop_end
	#endif
	#if NUM_POINT_LIGHT_SHADOWS > 0
		#pragma unroll_loop_start
		for ( int i = 0; i < NUM_POINT_LIGHT_SHADOWS; i ++ ) {
			shadowWorldPosition = worldPosition + vec4( shadowWorldNormal * pointLightShadows[ i ].shadowNormalBias, 0 );
			vPointShadowCoord[ i ] = pointShadowMatrix[ i ] * shadowWorldPosition;
		}
		#pragma unroll_loop_end
	#endif
#endif
#if NUM_SPOT_LIGHT_COORDS > 0
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_SPOT_LIGHT_COORDS; i ++ ) {
		shadowWorldPosition = worldPosition;
		#if ( defined( USE_SHADOWMAP ) && UNROLLED_LOOP_INDEX < NUM_SPOT_LIGHT_SHADOWS )
			shadowWorldPosition.xyz += shadowWorldNormal * spotLightShadows[ i ].shadowNormalBias;
		#endif
		vSpotLightCoord[ i ] = spotLightMatrix[ i ] * shadowWorldPosition;
	}
	#pragma unroll_loop_end
#endif`,shadowmask_pars_fragment:`float getShadowMask() {
	float shadow = 1.0;
	#ifdef USE_SHADOWMAP
	#if NUM_DIR_LIGHT_SHADOWS > 0
	DirectionalLightShadow directionalLight;
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_DIR_LIGHT_SHADOWS; i ++ ) {
		directionalLight = directionalLightShadows[ i ];
		shadow *= receiveShadow ? getShadow( directionalShadowMap[ i ], directionalLight.shadowMapSize, directionalLight.shadowIntensity, directionalLight.shadowBias, directionalLight.shadowRadius, vDirectionalShadowCoord[ i ] ) : 1.0;
	}
	#pragma unroll_loop_end
	#endif
	#if NUM_SPOT_LIGHT_SHADOWS > 0
	SpotLightShadow spotLight;
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_SPOT_LIGHT_SHADOWS; i ++ ) {
		spotLight = spotLightShadows[ i ];
		shadow *= receiveShadow ? getShadow( spotShadowMap[ i ], spotLight.shadowMapSize, spotLight.shadowIntensity, spotLight.shadowBias, spotLight.shadowRadius, vSpotLightCoord[ i ] ) : 1.0;
	}
	#pragma unroll_loop_end
	#endif
	#if NUM_POINT_LIGHT_SHADOWS > 0 && ( defined( SHADOWMAP_TYPE_PCF ) || defined( SHADOWMAP_TYPE_BASIC ) )
	PointLightShadow pointLight;
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_POINT_LIGHT_SHADOWS; i ++ ) {
		pointLight = pointLightShadows[ i ];
		shadow *= receiveShadow ? getPointShadow( pointShadowMap[ i ], pointLight.shadowMapSize, pointLight.shadowIntensity, pointLight.shadowBias, pointLight.shadowRadius, vPointShadowCoord[ i ], pointLight.shadowCameraNear, pointLight.shadowCameraFar ) : 1.0;
	}
	#pragma unroll_loop_end
	#endif
	#endif
	return shadow;
}`,skinbase_vertex:`#ifdef USE_SKINNING
	mat4 boneMatX = getBoneMatrix( skinIndex.x );
	mat4 boneMatY = getBoneMatrix( skinIndex.y );
	mat4 boneMatZ = getBoneMatrix( skinIndex.z );
	mat4 boneMatW = getBoneMatrix( skinIndex.w );
#endif`,skinning_pars_vertex:`#ifdef USE_SKINNING
	uniform mat4 bindMatrix;
	uniform mat4 bindMatrixInverse;
	uniform highp sampler2D boneTexture;
	mat4 getBoneMatrix( const in float i ) {
		int size = textureSize( boneTexture, 0 ).x;
		int j = int( i ) * 4;
		int x = j % size;
		int y = j / size;
		vec4 v1 = texelFetch( boneTexture, ivec2( x, y ), 0 );
		vec4 v2 = texelFetch( boneTexture, ivec2( x + 1, y ), 0 );
		vec4 v3 = texelFetch( boneTexture, ivec2( x + 2, y ), 0 );
		vec4 v4 = texelFetch( boneTexture, ivec2( x + 3, y ), 0 );
		return mat4( v1, v2, v3, v4 );
	}
#endif`,skinning_vertex:`#ifdef USE_SKINNING
	vec4 skinVertex = bindMatrix * vec4( transformed, 1.0 );
	vec4 skinned = vec4( 0.0 );
	skinned += boneMatX * skinVertex * skinWeight.x;
	skinned += boneMatY * skinVertex * skinWeight.y;
	skinned += boneMatZ * skinVertex * skinWeight.z;
	skinned += boneMatW * skinVertex * skinWeight.w;
	transformed = ( bindMatrixInverse * skinned ).xyz;
#endif`,skinnormal_vertex:`#ifdef USE_SKINNING
	mat4 skinMatrix = mat4( 0.0 );
	skinMatrix += skinWeight.x * boneMatX;
	skinMatrix += skinWeight.y * boneMatY;
	skinMatrix += skinWeight.z * boneMatZ;
	skinMatrix += skinWeight.w * boneMatW;
	skinMatrix = bindMatrixInverse * skinMatrix * bindMatrix;
	objectNormal = vec4( skinMatrix * vec4( objectNormal, 0.0 ) ).xyz;
	#ifdef USE_TANGENT
		objectTangent = vec4( skinMatrix * vec4( objectTangent, 0.0 ) ).xyz;
	#endif
#endif`,specularmap_fragment:`float specularStrength;
#ifdef USE_SPECULARMAP
	vec4 texelSpecular = texture2D( specularMap, vSpecularMapUv );
	specularStrength = texelSpecular.r;
#else
	specularStrength = 1.0;
#endif`,specularmap_pars_fragment:`#ifdef USE_SPECULARMAP
	uniform sampler2D specularMap;
#endif`,tonemapping_fragment:`#if defined( TONE_MAPPING )
	gl_FragColor.rgb = toneMapping( gl_FragColor.rgb );
#endif`,tonemapping_pars_fragment:`#ifndef saturate
#define saturate( a ) clamp( a, 0.0, 1.0 )
#endif
uniform float toneMappingExposure;
vec3 LinearToneMapping( vec3 color ) {
	return saturate( toneMappingExposure * color );
}
vec3 ReinhardToneMapping( vec3 color ) {
	color *= toneMappingExposure;
	return saturate( color / ( vec3( 1.0 ) + color ) );
}
vec3 CineonToneMapping( vec3 color ) {
	color *= toneMappingExposure;
	color = max( vec3( 0.0 ), color - 0.004 );
	return pow( ( color * ( 6.2 * color + 0.5 ) ) / ( color * ( 6.2 * color + 1.7 ) + 0.06 ), vec3( 2.2 ) );
}
vec3 RRTAndODTFit( vec3 v ) {
	vec3 a = v * ( v + 0.0245786 ) - 0.000090537;
	vec3 b = v * ( 0.983729 * v + 0.4329510 ) + 0.238081;
	return a / b;
}
vec3 ACESFilmicToneMapping( vec3 color ) {
	const mat3 ACESInputMat = mat3(
		vec3( 0.59719, 0.07600, 0.02840 ),		vec3( 0.35458, 0.90834, 0.13383 ),
		vec3( 0.04823, 0.01566, 0.83777 )
	);
	const mat3 ACESOutputMat = mat3(
		vec3(  1.60475, -0.10208, -0.00327 ),		vec3( -0.53108,  1.10813, -0.07276 ),
		vec3( -0.07367, -0.00605,  1.07602 )
	);
	color *= toneMappingExposure / 0.6;
	color = ACESInputMat * color;
	color = RRTAndODTFit( color );
	color = ACESOutputMat * color;
	return saturate( color );
}
const mat3 LINEAR_REC2020_TO_LINEAR_SRGB = mat3(
	vec3( 1.6605, - 0.1246, - 0.0182 ),
	vec3( - 0.5876, 1.1329, - 0.1006 ),
	vec3( - 0.0728, - 0.0083, 1.1187 )
);
const mat3 LINEAR_SRGB_TO_LINEAR_REC2020 = mat3(
	vec3( 0.6274, 0.0691, 0.0164 ),
	vec3( 0.3293, 0.9195, 0.0880 ),
	vec3( 0.0433, 0.0113, 0.8956 )
);
vec3 agxDefaultContrastApprox( vec3 x ) {
	vec3 x2 = x * x;
	vec3 x4 = x2 * x2;
	return + 15.5 * x4 * x2
		- 40.14 * x4 * x
		+ 31.96 * x4
		- 6.868 * x2 * x
		+ 0.4298 * x2
		+ 0.1191 * x
		- 0.00232;
}
vec3 AgXToneMapping( vec3 color ) {
	const mat3 AgXInsetMatrix = mat3(
		vec3( 0.856627153315983, 0.137318972929847, 0.11189821299995 ),
		vec3( 0.0951212405381588, 0.761241990602591, 0.0767994186031903 ),
		vec3( 0.0482516061458583, 0.101439036467562, 0.811302368396859 )
	);
	const mat3 AgXOutsetMatrix = mat3(
		vec3( 1.1271005818144368, - 0.1413297634984383, - 0.14132976349843826 ),
		vec3( - 0.11060664309660323, 1.157823702216272, - 0.11060664309660294 ),
		vec3( - 0.016493938717834573, - 0.016493938717834257, 1.2519364065950405 )
	);
	const float AgxMinEv = - 12.47393;	const float AgxMaxEv = 4.026069;
	color *= toneMappingExposure;
	color = LINEAR_SRGB_TO_LINEAR_REC2020 * color;
	color = AgXInsetMatrix * color;
	color = max( color, 1e-10 );	color = log2( color );
	color = ( color - AgxMinEv ) / ( AgxMaxEv - AgxMinEv );
	color = clamp( color, 0.0, 1.0 );
	color = agxDefaultContrastApprox( color );
	color = AgXOutsetMatrix * color;
	color = pow( max( vec3( 0.0 ), color ), vec3( 2.2 ) );
	color = LINEAR_REC2020_TO_LINEAR_SRGB * color;
	color = clamp( color, 0.0, 1.0 );
	return color;
}
vec3 NeutralToneMapping( vec3 color ) {
	const float StartCompression = 0.8 - 0.04;
	const float Desaturation = 0.15;
	color *= toneMappingExposure;
	float x = min( color.r, min( color.g, color.b ) );
	float offset = x < 0.08 ? x - 6.25 * x * x : 0.04;
	color -= offset;
	float peak = max( color.r, max( color.g, color.b ) );
	if ( peak < StartCompression ) return color;
	float d = 1. - StartCompression;
	float newPeak = 1. - d * d / ( peak + d - StartCompression );
	color *= newPeak / peak;
	float g = 1. - 1. / ( Desaturation * ( peak - newPeak ) + 1. );
	return mix( color, vec3( newPeak ), g );
}
vec3 CustomToneMapping( vec3 color ) { return color; }`,transmission_fragment:`#ifdef USE_TRANSMISSION
	material.transmission = transmission;
	material.transmissionAlpha = 1.0;
	material.thickness = thickness;
	material.attenuationDistance = attenuationDistance;
	material.attenuationColor = attenuationColor;
	#ifdef USE_TRANSMISSIONMAP
		material.transmission *= texture2D( transmissionMap, vTransmissionMapUv ).r;
	#endif
	#ifdef USE_THICKNESSMAP
		material.thickness *= texture2D( thicknessMap, vThicknessMapUv ).g;
	#endif
	vec3 pos = vWorldPosition;
	vec3 v = normalize( cameraPosition - pos );
	vec3 n = inverseTransformDirection( normal, viewMatrix );
	vec4 transmitted = getIBLVolumeRefraction(
		n, v, material.roughness, material.diffuseContribution, material.specularColorBlended, material.specularF90,
		pos, modelMatrix, viewMatrix, projectionMatrix, material.dispersion, material.ior, material.thickness,
		material.attenuationColor, material.attenuationDistance );
	material.transmissionAlpha = mix( material.transmissionAlpha, transmitted.a, material.transmission );
	totalDiffuse = mix( totalDiffuse, transmitted.rgb, material.transmission );
#endif`,transmission_pars_fragment:`#ifdef USE_TRANSMISSION
	uniform float transmission;
	uniform float thickness;
	uniform float attenuationDistance;
	uniform vec3 attenuationColor;
	#ifdef USE_TRANSMISSIONMAP
		uniform sampler2D transmissionMap;
	#endif
	#ifdef USE_THICKNESSMAP
		uniform sampler2D thicknessMap;
	#endif
	uniform vec2 transmissionSamplerSize;
	uniform sampler2D transmissionSamplerMap;
	uniform mat4 modelMatrix;
	uniform mat4 projectionMatrix;
	varying vec3 vWorldPosition;
	float w0( float a ) {
		return ( 1.0 / 6.0 ) * ( a * ( a * ( - a + 3.0 ) - 3.0 ) + 1.0 );
	}
	float w1( float a ) {
		return ( 1.0 / 6.0 ) * ( a *  a * ( 3.0 * a - 6.0 ) + 4.0 );
	}
	float w2( float a ){
		return ( 1.0 / 6.0 ) * ( a * ( a * ( - 3.0 * a + 3.0 ) + 3.0 ) + 1.0 );
	}
	float w3( float a ) {
		return ( 1.0 / 6.0 ) * ( a * a * a );
	}
	float g0( float a ) {
		return w0( a ) + w1( a );
	}
	float g1( float a ) {
		return w2( a ) + w3( a );
	}
	float h0( float a ) {
		return - 1.0 + w1( a ) / ( w0( a ) + w1( a ) );
	}
	float h1( float a ) {
		return 1.0 + w3( a ) / ( w2( a ) + w3( a ) );
	}
	vec4 bicubic( sampler2D tex, vec2 uv, vec4 texelSize, float lod ) {
		uv = uv * texelSize.zw + 0.5;
		vec2 iuv = floor( uv );
		vec2 fuv = fract( uv );
		float g0x = g0( fuv.x );
		float g1x = g1( fuv.x );
		float h0x = h0( fuv.x );
		float h1x = h1( fuv.x );
		float h0y = h0( fuv.y );
		float h1y = h1( fuv.y );
		vec2 p0 = ( vec2( iuv.x + h0x, iuv.y + h0y ) - 0.5 ) * texelSize.xy;
		vec2 p1 = ( vec2( iuv.x + h1x, iuv.y + h0y ) - 0.5 ) * texelSize.xy;
		vec2 p2 = ( vec2( iuv.x + h0x, iuv.y + h1y ) - 0.5 ) * texelSize.xy;
		vec2 p3 = ( vec2( iuv.x + h1x, iuv.y + h1y ) - 0.5 ) * texelSize.xy;
		return g0( fuv.y ) * ( g0x * textureLod( tex, p0, lod ) + g1x * textureLod( tex, p1, lod ) ) +
			g1( fuv.y ) * ( g0x * textureLod( tex, p2, lod ) + g1x * textureLod( tex, p3, lod ) );
	}
	vec4 textureBicubic( sampler2D sampler, vec2 uv, float lod ) {
		vec2 fLodSize = vec2( textureSize( sampler, int( lod ) ) );
		vec2 cLodSize = vec2( textureSize( sampler, int( lod + 1.0 ) ) );
		vec2 fLodSizeInv = 1.0 / fLodSize;
		vec2 cLodSizeInv = 1.0 / cLodSize;
		vec4 fSample = bicubic( sampler, uv, vec4( fLodSizeInv, fLodSize ), floor( lod ) );
		vec4 cSample = bicubic( sampler, uv, vec4( cLodSizeInv, cLodSize ), ceil( lod ) );
		return mix( fSample, cSample, fract( lod ) );
	}
	vec3 getVolumeTransmissionRay( const in vec3 n, const in vec3 v, const in float thickness, const in float ior, const in mat4 modelMatrix ) {
		vec3 refractionVector = refract( - v, normalize( n ), 1.0 / ior );
		vec3 modelScale;
		modelScale.x = length( vec3( modelMatrix[ 0 ].xyz ) );
		modelScale.y = length( vec3( modelMatrix[ 1 ].xyz ) );
		modelScale.z = length( vec3( modelMatrix[ 2 ].xyz ) );
		return normalize( refractionVector ) * thickness * modelScale;
	}
	float applyIorToRoughness( const in float roughness, const in float ior ) {
		return roughness * clamp( ior * 2.0 - 2.0, 0.0, 1.0 );
	}
	vec4 getTransmissionSample( const in vec2 fragCoord, const in float roughness, const in float ior ) {
		float lod = log2( transmissionSamplerSize.x ) * applyIorToRoughness( roughness, ior );
		return textureBicubic( transmissionSamplerMap, fragCoord.xy, lod );
	}
	vec3 volumeAttenuation( const in float transmissionDistance, const in vec3 attenuationColor, const in float attenuationDistance ) {
		if ( isinf( attenuationDistance ) ) {
			return vec3( 1.0 );
		} else {
			vec3 attenuationCoefficient = -log( attenuationColor ) / attenuationDistance;
			vec3 transmittance = exp( - attenuationCoefficient * transmissionDistance );			return transmittance;
		}
	}
	vec4 getIBLVolumeRefraction( const in vec3 n, const in vec3 v, const in float roughness, const in vec3 diffuseColor,
		const in vec3 specularColor, const in float specularF90, const in vec3 position, const in mat4 modelMatrix,
		const in mat4 viewMatrix, const in mat4 projMatrix, const in float dispersion, const in float ior, const in float thickness,
		const in vec3 attenuationColor, const in float attenuationDistance ) {
		vec4 transmittedLight;
		vec3 transmittance;
		#ifdef USE_DISPERSION
			float halfSpread = ( ior - 1.0 ) * 0.025 * dispersion;
			vec3 iors = vec3( ior - halfSpread, ior, ior + halfSpread );
			for ( int i = 0; i < 3; i ++ ) {
				vec3 transmissionRay = getVolumeTransmissionRay( n, v, thickness, iors[ i ], modelMatrix );
				vec3 refractedRayExit = position + transmissionRay;
				vec4 ndcPos = projMatrix * viewMatrix * vec4( refractedRayExit, 1.0 );
				vec2 refractionCoords = ndcPos.xy / ndcPos.w;
				refractionCoords += 1.0;
				refractionCoords /= 2.0;
				vec4 transmissionSample = getTransmissionSample( refractionCoords, roughness, iors[ i ] );
				transmittedLight[ i ] = transmissionSample[ i ];
				transmittedLight.a += transmissionSample.a;
				transmittance[ i ] = diffuseColor[ i ] * volumeAttenuation( length( transmissionRay ), attenuationColor, attenuationDistance )[ i ];
			}
			transmittedLight.a /= 3.0;
		#else
			vec3 transmissionRay = getVolumeTransmissionRay( n, v, thickness, ior, modelMatrix );
			vec3 refractedRayExit = position + transmissionRay;
			vec4 ndcPos = projMatrix * viewMatrix * vec4( refractedRayExit, 1.0 );
			vec2 refractionCoords = ndcPos.xy / ndcPos.w;
			refractionCoords += 1.0;
			refractionCoords /= 2.0;
			transmittedLight = getTransmissionSample( refractionCoords, roughness, ior );
			transmittance = diffuseColor * volumeAttenuation( length( transmissionRay ), attenuationColor, attenuationDistance );
		#endif
		vec3 attenuatedColor = transmittance * transmittedLight.rgb;
		vec3 F = EnvironmentBRDF( n, v, specularColor, specularF90, roughness );
		float transmittanceFactor = ( transmittance.r + transmittance.g + transmittance.b ) / 3.0;
		return vec4( ( 1.0 - F ) * attenuatedColor, 1.0 - ( 1.0 - transmittedLight.a ) * transmittanceFactor );
	}
#endif`,uv_pars_fragment:`#if defined( USE_UV ) || defined( USE_ANISOTROPY )
	varying vec2 vUv;
#endif
#ifdef USE_MAP
	varying vec2 vMapUv;
#endif
#ifdef USE_ALPHAMAP
	varying vec2 vAlphaMapUv;
#endif
#ifdef USE_LIGHTMAP
	varying vec2 vLightMapUv;
#endif
#ifdef USE_AOMAP
	varying vec2 vAoMapUv;
#endif
#ifdef USE_BUMPMAP
	varying vec2 vBumpMapUv;
#endif
#ifdef USE_NORMALMAP
	varying vec2 vNormalMapUv;
#endif
#ifdef USE_EMISSIVEMAP
	varying vec2 vEmissiveMapUv;
#endif
#ifdef USE_METALNESSMAP
	varying vec2 vMetalnessMapUv;
#endif
#ifdef USE_ROUGHNESSMAP
	varying vec2 vRoughnessMapUv;
#endif
#ifdef USE_ANISOTROPYMAP
	varying vec2 vAnisotropyMapUv;
#endif
#ifdef USE_CLEARCOATMAP
	varying vec2 vClearcoatMapUv;
#endif
#ifdef USE_CLEARCOAT_NORMALMAP
	varying vec2 vClearcoatNormalMapUv;
#endif
#ifdef USE_CLEARCOAT_ROUGHNESSMAP
	varying vec2 vClearcoatRoughnessMapUv;
#endif
#ifdef USE_IRIDESCENCEMAP
	varying vec2 vIridescenceMapUv;
#endif
#ifdef USE_IRIDESCENCE_THICKNESSMAP
	varying vec2 vIridescenceThicknessMapUv;
#endif
#ifdef USE_SHEEN_COLORMAP
	varying vec2 vSheenColorMapUv;
#endif
#ifdef USE_SHEEN_ROUGHNESSMAP
	varying vec2 vSheenRoughnessMapUv;
#endif
#ifdef USE_SPECULARMAP
	varying vec2 vSpecularMapUv;
#endif
#ifdef USE_SPECULAR_COLORMAP
	varying vec2 vSpecularColorMapUv;
#endif
#ifdef USE_SPECULAR_INTENSITYMAP
	varying vec2 vSpecularIntensityMapUv;
#endif
#ifdef USE_TRANSMISSIONMAP
	uniform mat3 transmissionMapTransform;
	varying vec2 vTransmissionMapUv;
#endif
#ifdef USE_THICKNESSMAP
	uniform mat3 thicknessMapTransform;
	varying vec2 vThicknessMapUv;
#endif`,uv_pars_vertex:`#if defined( USE_UV ) || defined( USE_ANISOTROPY )
	varying vec2 vUv;
#endif
#ifdef USE_MAP
	uniform mat3 mapTransform;
	varying vec2 vMapUv;
#endif
#ifdef USE_ALPHAMAP
	uniform mat3 alphaMapTransform;
	varying vec2 vAlphaMapUv;
#endif
#ifdef USE_LIGHTMAP
	uniform mat3 lightMapTransform;
	varying vec2 vLightMapUv;
#endif
#ifdef USE_AOMAP
	uniform mat3 aoMapTransform;
	varying vec2 vAoMapUv;
#endif
#ifdef USE_BUMPMAP
	uniform mat3 bumpMapTransform;
	varying vec2 vBumpMapUv;
#endif
#ifdef USE_NORMALMAP
	uniform mat3 normalMapTransform;
	varying vec2 vNormalMapUv;
#endif
#ifdef USE_DISPLACEMENTMAP
	uniform mat3 displacementMapTransform;
	varying vec2 vDisplacementMapUv;
#endif
#ifdef USE_EMISSIVEMAP
	uniform mat3 emissiveMapTransform;
	varying vec2 vEmissiveMapUv;
#endif
#ifdef USE_METALNESSMAP
	uniform mat3 metalnessMapTransform;
	varying vec2 vMetalnessMapUv;
#endif
#ifdef USE_ROUGHNESSMAP
	uniform mat3 roughnessMapTransform;
	varying vec2 vRoughnessMapUv;
#endif
#ifdef USE_ANISOTROPYMAP
	uniform mat3 anisotropyMapTransform;
	varying vec2 vAnisotropyMapUv;
#endif
#ifdef USE_CLEARCOATMAP
	uniform mat3 clearcoatMapTransform;
	varying vec2 vClearcoatMapUv;
#endif
#ifdef USE_CLEARCOAT_NORMALMAP
	uniform mat3 clearcoatNormalMapTransform;
	varying vec2 vClearcoatNormalMapUv;
#endif
#ifdef USE_CLEARCOAT_ROUGHNESSMAP
	uniform mat3 clearcoatRoughnessMapTransform;
	varying vec2 vClearcoatRoughnessMapUv;
#endif
#ifdef USE_SHEEN_COLORMAP
	uniform mat3 sheenColorMapTransform;
	varying vec2 vSheenColorMapUv;
#endif
#ifdef USE_SHEEN_ROUGHNESSMAP
	uniform mat3 sheenRoughnessMapTransform;
	varying vec2 vSheenRoughnessMapUv;
#endif
#ifdef USE_IRIDESCENCEMAP
	uniform mat3 iridescenceMapTransform;
	varying vec2 vIridescenceMapUv;
#endif
#ifdef USE_IRIDESCENCE_THICKNESSMAP
	uniform mat3 iridescenceThicknessMapTransform;
	varying vec2 vIridescenceThicknessMapUv;
#endif
#ifdef USE_SPECULARMAP
	uniform mat3 specularMapTransform;
	varying vec2 vSpecularMapUv;
#endif
#ifdef USE_SPECULAR_COLORMAP
	uniform mat3 specularColorMapTransform;
	varying vec2 vSpecularColorMapUv;
#endif
#ifdef USE_SPECULAR_INTENSITYMAP
	uniform mat3 specularIntensityMapTransform;
	varying vec2 vSpecularIntensityMapUv;
#endif
#ifdef USE_TRANSMISSIONMAP
	uniform mat3 transmissionMapTransform;
	varying vec2 vTransmissionMapUv;
#endif
#ifdef USE_THICKNESSMAP
	uniform mat3 thicknessMapTransform;
	varying vec2 vThicknessMapUv;
#endif`,uv_vertex:`#if defined( USE_UV ) || defined( USE_ANISOTROPY )
	vUv = vec3( uv, 1 ).xy;
#endif
#ifdef USE_MAP
	vMapUv = ( mapTransform * vec3( MAP_UV, 1 ) ).xy;
#endif
#ifdef USE_ALPHAMAP
	vAlphaMapUv = ( alphaMapTransform * vec3( ALPHAMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_LIGHTMAP
	vLightMapUv = ( lightMapTransform * vec3( LIGHTMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_AOMAP
	vAoMapUv = ( aoMapTransform * vec3( AOMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_BUMPMAP
	vBumpMapUv = ( bumpMapTransform * vec3( BUMPMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_NORMALMAP
	vNormalMapUv = ( normalMapTransform * vec3( NORMALMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_DISPLACEMENTMAP
	vDisplacementMapUv = ( displacementMapTransform * vec3( DISPLACEMENTMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_EMISSIVEMAP
	vEmissiveMapUv = ( emissiveMapTransform * vec3( EMISSIVEMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_METALNESSMAP
	vMetalnessMapUv = ( metalnessMapTransform * vec3( METALNESSMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_ROUGHNESSMAP
	vRoughnessMapUv = ( roughnessMapTransform * vec3( ROUGHNESSMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_ANISOTROPYMAP
	vAnisotropyMapUv = ( anisotropyMapTransform * vec3( ANISOTROPYMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_CLEARCOATMAP
	vClearcoatMapUv = ( clearcoatMapTransform * vec3( CLEARCOATMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_CLEARCOAT_NORMALMAP
	vClearcoatNormalMapUv = ( clearcoatNormalMapTransform * vec3( CLEARCOAT_NORMALMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_CLEARCOAT_ROUGHNESSMAP
	vClearcoatRoughnessMapUv = ( clearcoatRoughnessMapTransform * vec3( CLEARCOAT_ROUGHNESSMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_IRIDESCENCEMAP
	vIridescenceMapUv = ( iridescenceMapTransform * vec3( IRIDESCENCEMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_IRIDESCENCE_THICKNESSMAP
	vIridescenceThicknessMapUv = ( iridescenceThicknessMapTransform * vec3( IRIDESCENCE_THICKNESSMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_SHEEN_COLORMAP
	vSheenColorMapUv = ( sheenColorMapTransform * vec3( SHEEN_COLORMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_SHEEN_ROUGHNESSMAP
	vSheenRoughnessMapUv = ( sheenRoughnessMapTransform * vec3( SHEEN_ROUGHNESSMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_SPECULARMAP
	vSpecularMapUv = ( specularMapTransform * vec3( SPECULARMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_SPECULAR_COLORMAP
	vSpecularColorMapUv = ( specularColorMapTransform * vec3( SPECULAR_COLORMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_SPECULAR_INTENSITYMAP
	vSpecularIntensityMapUv = ( specularIntensityMapTransform * vec3( SPECULAR_INTENSITYMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_TRANSMISSIONMAP
	vTransmissionMapUv = ( transmissionMapTransform * vec3( TRANSMISSIONMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_THICKNESSMAP
	vThicknessMapUv = ( thicknessMapTransform * vec3( THICKNESSMAP_UV, 1 ) ).xy;
#endif`,worldpos_vertex:`#if defined( USE_ENVMAP ) || defined( DISTANCE ) || defined ( USE_SHADOWMAP ) || defined ( USE_TRANSMISSION ) || NUM_SPOT_LIGHT_COORDS > 0
	vec4 worldPosition = vec4( transformed, 1.0 );
	#ifdef USE_BATCHING
		worldPosition = batchingMatrix * worldPosition;
	#endif
	#ifdef USE_INSTANCING
		worldPosition = instanceMatrix * worldPosition;
	#endif
	worldPosition = modelMatrix * worldPosition;
#endif`,background_vert:`varying vec2 vUv;
uniform mat3 uvTransform;
void main() {
	vUv = ( uvTransform * vec3( uv, 1 ) ).xy;
	gl_Position = vec4( position.xy, 1.0, 1.0 );
}`,background_frag:`uniform sampler2D t2D;
uniform float backgroundIntensity;
varying vec2 vUv;
void main() {
	vec4 texColor = texture2D( t2D, vUv );
	#ifdef DECODE_VIDEO_TEXTURE
		texColor = vec4( mix( pow( texColor.rgb * 0.9478672986 + vec3( 0.0521327014 ), vec3( 2.4 ) ), texColor.rgb * 0.0773993808, vec3( lessThanEqual( texColor.rgb, vec3( 0.04045 ) ) ) ), texColor.w );
	#endif
	texColor.rgb *= backgroundIntensity;
	gl_FragColor = texColor;
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
}`,backgroundCube_vert:`varying vec3 vWorldDirection;
#include <common>
void main() {
	vWorldDirection = transformDirection( position, modelMatrix );
	#include <begin_vertex>
	#include <project_vertex>
	gl_Position.z = gl_Position.w;
}`,backgroundCube_frag:`#ifdef ENVMAP_TYPE_CUBE
	uniform samplerCube envMap;
#elif defined( ENVMAP_TYPE_CUBE_UV )
	uniform sampler2D envMap;
#endif
uniform float backgroundBlurriness;
uniform float backgroundIntensity;
uniform mat3 backgroundRotation;
varying vec3 vWorldDirection;
#include <cube_uv_reflection_fragment>
void main() {
	#ifdef ENVMAP_TYPE_CUBE
		vec4 texColor = textureCube( envMap, backgroundRotation * vWorldDirection );
	#elif defined( ENVMAP_TYPE_CUBE_UV )
		vec4 texColor = textureCubeUV( envMap, backgroundRotation * vWorldDirection, backgroundBlurriness );
	#else
		vec4 texColor = vec4( 0.0, 0.0, 0.0, 1.0 );
	#endif
	texColor.rgb *= backgroundIntensity;
	gl_FragColor = texColor;
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
}`,cube_vert:`varying vec3 vWorldDirection;
#include <common>
void main() {
	vWorldDirection = transformDirection( position, modelMatrix );
	#include <begin_vertex>
	#include <project_vertex>
	gl_Position.z = gl_Position.w;
}`,cube_frag:`uniform samplerCube tCube;
uniform float tFlip;
uniform float opacity;
varying vec3 vWorldDirection;
void main() {
	vec4 texColor = textureCube( tCube, vec3( tFlip * vWorldDirection.x, vWorldDirection.yz ) );
	gl_FragColor = texColor;
	gl_FragColor.a *= opacity;
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
}`,depth_vert:`#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <displacementmap_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
varying vec2 vHighPrecisionZW;
void main() {
	#include <uv_vertex>
	#include <batching_vertex>
	#include <skinbase_vertex>
	#include <morphinstance_vertex>
	#ifdef USE_DISPLACEMENTMAP
		#include <beginnormal_vertex>
		#include <morphnormal_vertex>
		#include <skinnormal_vertex>
	#endif
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	vHighPrecisionZW = gl_Position.zw;
}`,depth_frag:`#if DEPTH_PACKING == 3200
	uniform float opacity;
#endif
#include <common>
#include <packing>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
varying vec2 vHighPrecisionZW;
void main() {
	vec4 diffuseColor = vec4( 1.0 );
	#include <clipping_planes_fragment>
	#if DEPTH_PACKING == 3200
		diffuseColor.a = opacity;
	#endif
	#include <map_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	#include <logdepthbuf_fragment>
	#ifdef USE_REVERSED_DEPTH_BUFFER
		float fragCoordZ = vHighPrecisionZW[ 0 ] / vHighPrecisionZW[ 1 ];
	#else
		float fragCoordZ = 0.5 * vHighPrecisionZW[ 0 ] / vHighPrecisionZW[ 1 ] + 0.5;
	#endif
	#if DEPTH_PACKING == 3200
		gl_FragColor = vec4( vec3( 1.0 - fragCoordZ ), opacity );
	#elif DEPTH_PACKING == 3201
		gl_FragColor = packDepthToRGBA( fragCoordZ );
	#elif DEPTH_PACKING == 3202
		gl_FragColor = vec4( packDepthToRGB( fragCoordZ ), 1.0 );
	#elif DEPTH_PACKING == 3203
		gl_FragColor = vec4( packDepthToRG( fragCoordZ ), 0.0, 1.0 );
	#endif
}`,distance_vert:`#define DISTANCE
varying vec3 vWorldPosition;
#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <displacementmap_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <batching_vertex>
	#include <skinbase_vertex>
	#include <morphinstance_vertex>
	#ifdef USE_DISPLACEMENTMAP
		#include <beginnormal_vertex>
		#include <morphnormal_vertex>
		#include <skinnormal_vertex>
	#endif
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <worldpos_vertex>
	#include <clipping_planes_vertex>
	vWorldPosition = worldPosition.xyz;
}`,distance_frag:`#define DISTANCE
uniform vec3 referencePosition;
uniform float nearDistance;
uniform float farDistance;
varying vec3 vWorldPosition;
#include <common>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <clipping_planes_pars_fragment>
void main () {
	vec4 diffuseColor = vec4( 1.0 );
	#include <clipping_planes_fragment>
	#include <map_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	float dist = length( vWorldPosition - referencePosition );
	dist = ( dist - nearDistance ) / ( farDistance - nearDistance );
	dist = saturate( dist );
	gl_FragColor = vec4( dist, 0.0, 0.0, 1.0 );
}`,equirect_vert:`varying vec3 vWorldDirection;
#include <common>
void main() {
	vWorldDirection = transformDirection( position, modelMatrix );
	#include <begin_vertex>
	#include <project_vertex>
}`,equirect_frag:`uniform sampler2D tEquirect;
varying vec3 vWorldDirection;
#include <common>
void main() {
	vec3 direction = normalize( vWorldDirection );
	vec2 sampleUV = equirectUv( direction );
	gl_FragColor = texture2D( tEquirect, sampleUV );
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
}`,linedashed_vert:`uniform float scale;
attribute float lineDistance;
varying float vLineDistance;
#include <common>
#include <uv_pars_vertex>
#include <color_pars_vertex>
#include <fog_pars_vertex>
#include <morphtarget_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	vLineDistance = scale * lineDistance;
	#include <uv_vertex>
	#include <color_vertex>
	#include <morphinstance_vertex>
	#include <morphcolor_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	#include <fog_vertex>
}`,linedashed_frag:`uniform vec3 diffuse;
uniform float opacity;
uniform float dashSize;
uniform float totalSize;
varying float vLineDistance;
#include <common>
#include <color_pars_fragment>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <fog_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	if ( mod( vLineDistance, totalSize ) > dashSize ) {
		discard;
	}
	vec3 outgoingLight = vec3( 0.0 );
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <color_fragment>
	outgoingLight = diffuseColor.rgb;
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
}`,meshbasic_vert:`#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <envmap_pars_vertex>
#include <color_pars_vertex>
#include <fog_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <color_vertex>
	#include <morphinstance_vertex>
	#include <morphcolor_vertex>
	#include <batching_vertex>
	#if defined ( USE_ENVMAP ) || defined ( USE_SKINNING )
		#include <beginnormal_vertex>
		#include <morphnormal_vertex>
		#include <skinbase_vertex>
		#include <skinnormal_vertex>
		#include <defaultnormal_vertex>
	#endif
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	#include <worldpos_vertex>
	#include <envmap_vertex>
	#include <fog_vertex>
}`,meshbasic_frag:`uniform vec3 diffuse;
uniform float opacity;
#ifndef FLAT_SHADED
	varying vec3 vNormal;
#endif
#include <common>
#include <dithering_pars_fragment>
#include <color_pars_fragment>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <aomap_pars_fragment>
#include <lightmap_pars_fragment>
#include <envmap_common_pars_fragment>
#include <envmap_pars_fragment>
#include <fog_pars_fragment>
#include <specularmap_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <color_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	#include <specularmap_fragment>
	ReflectedLight reflectedLight = ReflectedLight( vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ) );
	#ifdef USE_LIGHTMAP
		vec4 lightMapTexel = texture2D( lightMap, vLightMapUv );
		reflectedLight.indirectDiffuse += lightMapTexel.rgb * lightMapIntensity * RECIPROCAL_PI;
	#else
		reflectedLight.indirectDiffuse += vec3( 1.0 );
	#endif
	#include <aomap_fragment>
	reflectedLight.indirectDiffuse *= diffuseColor.rgb;
	vec3 outgoingLight = reflectedLight.indirectDiffuse;
	#include <envmap_fragment>
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
	#include <dithering_fragment>
}`,meshlambert_vert:`#define LAMBERT
varying vec3 vViewPosition;
#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <displacementmap_pars_vertex>
#include <envmap_pars_vertex>
#include <color_pars_vertex>
#include <fog_pars_vertex>
#include <normal_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <shadowmap_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <color_vertex>
	#include <morphinstance_vertex>
	#include <morphcolor_vertex>
	#include <batching_vertex>
	#include <beginnormal_vertex>
	#include <morphnormal_vertex>
	#include <skinbase_vertex>
	#include <skinnormal_vertex>
	#include <defaultnormal_vertex>
	#include <normal_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	vViewPosition = - mvPosition.xyz;
	#include <worldpos_vertex>
	#include <envmap_vertex>
	#include <shadowmap_vertex>
	#include <fog_vertex>
}`,meshlambert_frag:`#define LAMBERT
uniform vec3 diffuse;
uniform vec3 emissive;
uniform float opacity;
#include <common>
#include <dithering_pars_fragment>
#include <color_pars_fragment>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <aomap_pars_fragment>
#include <lightmap_pars_fragment>
#include <emissivemap_pars_fragment>
#include <cube_uv_reflection_fragment>
#include <envmap_common_pars_fragment>
#include <envmap_pars_fragment>
#include <envmap_physical_pars_fragment>
#include <fog_pars_fragment>
#include <bsdfs>
#include <lights_pars_begin>
#include <normal_pars_fragment>
#include <lights_lambert_pars_fragment>
#include <shadowmap_pars_fragment>
#include <bumpmap_pars_fragment>
#include <normalmap_pars_fragment>
#include <specularmap_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	ReflectedLight reflectedLight = ReflectedLight( vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ) );
	vec3 totalEmissiveRadiance = emissive;
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <color_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	#include <specularmap_fragment>
	#include <normal_fragment_begin>
	#include <normal_fragment_maps>
	#include <emissivemap_fragment>
	#include <lights_lambert_fragment>
	#include <lights_fragment_begin>
	#include <lights_fragment_maps>
	#include <lights_fragment_end>
	#include <aomap_fragment>
	vec3 outgoingLight = reflectedLight.directDiffuse + reflectedLight.indirectDiffuse + totalEmissiveRadiance;
	#include <envmap_fragment>
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
	#include <dithering_fragment>
}`,meshmatcap_vert:`#define MATCAP
varying vec3 vViewPosition;
#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <color_pars_vertex>
#include <displacementmap_pars_vertex>
#include <fog_pars_vertex>
#include <normal_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <color_vertex>
	#include <morphinstance_vertex>
	#include <morphcolor_vertex>
	#include <batching_vertex>
	#include <beginnormal_vertex>
	#include <morphnormal_vertex>
	#include <skinbase_vertex>
	#include <skinnormal_vertex>
	#include <defaultnormal_vertex>
	#include <normal_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	#include <fog_vertex>
	vViewPosition = - mvPosition.xyz;
}`,meshmatcap_frag:`#define MATCAP
uniform vec3 diffuse;
uniform float opacity;
uniform sampler2D matcap;
varying vec3 vViewPosition;
#include <common>
#include <dithering_pars_fragment>
#include <color_pars_fragment>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <fog_pars_fragment>
#include <normal_pars_fragment>
#include <bumpmap_pars_fragment>
#include <normalmap_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <color_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	#include <normal_fragment_begin>
	#include <normal_fragment_maps>
	vec3 viewDir = normalize( vViewPosition );
	vec3 x = normalize( vec3( viewDir.z, 0.0, - viewDir.x ) );
	vec3 y = cross( viewDir, x );
	vec2 uv = vec2( dot( x, normal ), dot( y, normal ) ) * 0.495 + 0.5;
	#ifdef USE_MATCAP
		vec4 matcapColor = texture2D( matcap, uv );
	#else
		vec4 matcapColor = vec4( vec3( mix( 0.2, 0.8, uv.y ) ), 1.0 );
	#endif
	vec3 outgoingLight = diffuseColor.rgb * matcapColor.rgb;
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
	#include <dithering_fragment>
}`,meshnormal_vert:`#define NORMAL
#if defined( FLAT_SHADED ) || defined( USE_BUMPMAP ) || defined( USE_NORMALMAP_TANGENTSPACE )
	varying vec3 vViewPosition;
#endif
#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <displacementmap_pars_vertex>
#include <normal_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <batching_vertex>
	#include <beginnormal_vertex>
	#include <morphinstance_vertex>
	#include <morphnormal_vertex>
	#include <skinbase_vertex>
	#include <skinnormal_vertex>
	#include <defaultnormal_vertex>
	#include <normal_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
#if defined( FLAT_SHADED ) || defined( USE_BUMPMAP ) || defined( USE_NORMALMAP_TANGENTSPACE )
	vViewPosition = - mvPosition.xyz;
#endif
}`,meshnormal_frag:`#define NORMAL
uniform float opacity;
#if defined( FLAT_SHADED ) || defined( USE_BUMPMAP ) || defined( USE_NORMALMAP_TANGENTSPACE )
	varying vec3 vViewPosition;
#endif
#include <uv_pars_fragment>
#include <normal_pars_fragment>
#include <bumpmap_pars_fragment>
#include <normalmap_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( 0.0, 0.0, 0.0, opacity );
	#include <clipping_planes_fragment>
	#include <logdepthbuf_fragment>
	#include <normal_fragment_begin>
	#include <normal_fragment_maps>
	gl_FragColor = vec4( normalize( normal ) * 0.5 + 0.5, diffuseColor.a );
	#ifdef OPAQUE
		gl_FragColor.a = 1.0;
	#endif
}`,meshphong_vert:`#define PHONG
varying vec3 vViewPosition;
#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <displacementmap_pars_vertex>
#include <envmap_pars_vertex>
#include <color_pars_vertex>
#include <fog_pars_vertex>
#include <normal_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <shadowmap_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <color_vertex>
	#include <morphcolor_vertex>
	#include <batching_vertex>
	#include <beginnormal_vertex>
	#include <morphinstance_vertex>
	#include <morphnormal_vertex>
	#include <skinbase_vertex>
	#include <skinnormal_vertex>
	#include <defaultnormal_vertex>
	#include <normal_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	vViewPosition = - mvPosition.xyz;
	#include <worldpos_vertex>
	#include <envmap_vertex>
	#include <shadowmap_vertex>
	#include <fog_vertex>
}`,meshphong_frag:`#define PHONG
uniform vec3 diffuse;
uniform vec3 emissive;
uniform vec3 specular;
uniform float shininess;
uniform float opacity;
#include <common>
#include <dithering_pars_fragment>
#include <color_pars_fragment>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <aomap_pars_fragment>
#include <lightmap_pars_fragment>
#include <emissivemap_pars_fragment>
#include <cube_uv_reflection_fragment>
#include <envmap_common_pars_fragment>
#include <envmap_pars_fragment>
#include <envmap_physical_pars_fragment>
#include <fog_pars_fragment>
#include <bsdfs>
#include <lights_pars_begin>
#include <normal_pars_fragment>
#include <lights_phong_pars_fragment>
#include <shadowmap_pars_fragment>
#include <bumpmap_pars_fragment>
#include <normalmap_pars_fragment>
#include <specularmap_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	ReflectedLight reflectedLight = ReflectedLight( vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ) );
	vec3 totalEmissiveRadiance = emissive;
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <color_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	#include <specularmap_fragment>
	#include <normal_fragment_begin>
	#include <normal_fragment_maps>
	#include <emissivemap_fragment>
	#include <lights_phong_fragment>
	#include <lights_fragment_begin>
	#include <lights_fragment_maps>
	#include <lights_fragment_end>
	#include <aomap_fragment>
	vec3 outgoingLight = reflectedLight.directDiffuse + reflectedLight.indirectDiffuse + reflectedLight.directSpecular + reflectedLight.indirectSpecular + totalEmissiveRadiance;
	#include <envmap_fragment>
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
	#include <dithering_fragment>
}`,meshphysical_vert:`#define STANDARD
varying vec3 vViewPosition;
#ifdef USE_TRANSMISSION
	varying vec3 vWorldPosition;
#endif
#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <displacementmap_pars_vertex>
#include <color_pars_vertex>
#include <fog_pars_vertex>
#include <normal_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <shadowmap_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <color_vertex>
	#include <morphinstance_vertex>
	#include <morphcolor_vertex>
	#include <batching_vertex>
	#include <beginnormal_vertex>
	#include <morphnormal_vertex>
	#include <skinbase_vertex>
	#include <skinnormal_vertex>
	#include <defaultnormal_vertex>
	#include <normal_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	vViewPosition = - mvPosition.xyz;
	#include <worldpos_vertex>
	#include <shadowmap_vertex>
	#include <fog_vertex>
#ifdef USE_TRANSMISSION
	vWorldPosition = worldPosition.xyz;
#endif
}`,meshphysical_frag:`#define STANDARD
#ifdef PHYSICAL
	#define IOR
	#define USE_SPECULAR
#endif
uniform vec3 diffuse;
uniform vec3 emissive;
uniform float roughness;
uniform float metalness;
uniform float opacity;
#ifdef IOR
	uniform float ior;
#endif
#ifdef USE_SPECULAR
	uniform float specularIntensity;
	uniform vec3 specularColor;
	#ifdef USE_SPECULAR_COLORMAP
		uniform sampler2D specularColorMap;
	#endif
	#ifdef USE_SPECULAR_INTENSITYMAP
		uniform sampler2D specularIntensityMap;
	#endif
#endif
#ifdef USE_CLEARCOAT
	uniform float clearcoat;
	uniform float clearcoatRoughness;
#endif
#ifdef USE_DISPERSION
	uniform float dispersion;
#endif
#ifdef USE_IRIDESCENCE
	uniform float iridescence;
	uniform float iridescenceIOR;
	uniform float iridescenceThicknessMinimum;
	uniform float iridescenceThicknessMaximum;
#endif
#ifdef USE_SHEEN
	uniform vec3 sheenColor;
	uniform float sheenRoughness;
	#ifdef USE_SHEEN_COLORMAP
		uniform sampler2D sheenColorMap;
	#endif
	#ifdef USE_SHEEN_ROUGHNESSMAP
		uniform sampler2D sheenRoughnessMap;
	#endif
#endif
#ifdef USE_ANISOTROPY
	uniform vec2 anisotropyVector;
	#ifdef USE_ANISOTROPYMAP
		uniform sampler2D anisotropyMap;
	#endif
#endif
varying vec3 vViewPosition;
#include <common>
#include <dithering_pars_fragment>
#include <color_pars_fragment>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <aomap_pars_fragment>
#include <lightmap_pars_fragment>
#include <emissivemap_pars_fragment>
#include <iridescence_fragment>
#include <cube_uv_reflection_fragment>
#include <envmap_common_pars_fragment>
#include <envmap_physical_pars_fragment>
#include <fog_pars_fragment>
#include <lights_pars_begin>
#include <normal_pars_fragment>
#include <lights_physical_pars_fragment>
#include <transmission_pars_fragment>
#include <shadowmap_pars_fragment>
#include <bumpmap_pars_fragment>
#include <normalmap_pars_fragment>
#include <clearcoat_pars_fragment>
#include <iridescence_pars_fragment>
#include <roughnessmap_pars_fragment>
#include <metalnessmap_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	ReflectedLight reflectedLight = ReflectedLight( vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ) );
	vec3 totalEmissiveRadiance = emissive;
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <color_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	#include <roughnessmap_fragment>
	#include <metalnessmap_fragment>
	#include <normal_fragment_begin>
	#include <normal_fragment_maps>
	#include <clearcoat_normal_fragment_begin>
	#include <clearcoat_normal_fragment_maps>
	#include <emissivemap_fragment>
	#include <lights_physical_fragment>
	#include <lights_fragment_begin>
	#include <lights_fragment_maps>
	#include <lights_fragment_end>
	#include <aomap_fragment>
	vec3 totalDiffuse = reflectedLight.directDiffuse + reflectedLight.indirectDiffuse;
	vec3 totalSpecular = reflectedLight.directSpecular + reflectedLight.indirectSpecular;
	#include <transmission_fragment>
	vec3 outgoingLight = totalDiffuse + totalSpecular + totalEmissiveRadiance;
	#ifdef USE_SHEEN
 
		outgoingLight = outgoingLight + sheenSpecularDirect + sheenSpecularIndirect;
 
 	#endif
	#ifdef USE_CLEARCOAT
		float dotNVcc = saturate( dot( geometryClearcoatNormal, geometryViewDir ) );
		vec3 Fcc = F_Schlick( material.clearcoatF0, material.clearcoatF90, dotNVcc );
		outgoingLight = outgoingLight * ( 1.0 - material.clearcoat * Fcc ) + ( clearcoatSpecularDirect + clearcoatSpecularIndirect ) * material.clearcoat;
	#endif
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
	#include <dithering_fragment>
}`,meshtoon_vert:`#define TOON
varying vec3 vViewPosition;
#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <displacementmap_pars_vertex>
#include <color_pars_vertex>
#include <fog_pars_vertex>
#include <normal_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <shadowmap_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <color_vertex>
	#include <morphinstance_vertex>
	#include <morphcolor_vertex>
	#include <batching_vertex>
	#include <beginnormal_vertex>
	#include <morphnormal_vertex>
	#include <skinbase_vertex>
	#include <skinnormal_vertex>
	#include <defaultnormal_vertex>
	#include <normal_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	vViewPosition = - mvPosition.xyz;
	#include <worldpos_vertex>
	#include <shadowmap_vertex>
	#include <fog_vertex>
}`,meshtoon_frag:`#define TOON
uniform vec3 diffuse;
uniform vec3 emissive;
uniform float opacity;
#include <common>
#include <dithering_pars_fragment>
#include <color_pars_fragment>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <aomap_pars_fragment>
#include <lightmap_pars_fragment>
#include <emissivemap_pars_fragment>
#include <gradientmap_pars_fragment>
#include <fog_pars_fragment>
#include <bsdfs>
#include <lights_pars_begin>
#include <normal_pars_fragment>
#include <lights_toon_pars_fragment>
#include <shadowmap_pars_fragment>
#include <bumpmap_pars_fragment>
#include <normalmap_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	ReflectedLight reflectedLight = ReflectedLight( vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ) );
	vec3 totalEmissiveRadiance = emissive;
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <color_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	#include <normal_fragment_begin>
	#include <normal_fragment_maps>
	#include <emissivemap_fragment>
	#include <lights_toon_fragment>
	#include <lights_fragment_begin>
	#include <lights_fragment_maps>
	#include <lights_fragment_end>
	#include <aomap_fragment>
	vec3 outgoingLight = reflectedLight.directDiffuse + reflectedLight.indirectDiffuse + totalEmissiveRadiance;
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
	#include <dithering_fragment>
}`,points_vert:`uniform float size;
uniform float scale;
#include <common>
#include <color_pars_vertex>
#include <fog_pars_vertex>
#include <morphtarget_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
#ifdef USE_POINTS_UV
	varying vec2 vUv;
	uniform mat3 uvTransform;
#endif
void main() {
	#ifdef USE_POINTS_UV
		vUv = ( uvTransform * vec3( uv, 1 ) ).xy;
	#endif
	#include <color_vertex>
	#include <morphinstance_vertex>
	#include <morphcolor_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <project_vertex>
	gl_PointSize = size;
	#ifdef USE_SIZEATTENUATION
		bool isPerspective = isPerspectiveMatrix( projectionMatrix );
		if ( isPerspective ) gl_PointSize *= ( scale / - mvPosition.z );
	#endif
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	#include <worldpos_vertex>
	#include <fog_vertex>
}`,points_frag:`uniform vec3 diffuse;
uniform float opacity;
#include <common>
#include <color_pars_fragment>
#include <map_particle_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <fog_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	vec3 outgoingLight = vec3( 0.0 );
	#include <logdepthbuf_fragment>
	#include <map_particle_fragment>
	#include <color_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	outgoingLight = diffuseColor.rgb;
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
}`,shadow_vert:`#include <common>
#include <batching_pars_vertex>
#include <fog_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <shadowmap_pars_vertex>
void main() {
	#include <batching_vertex>
	#include <beginnormal_vertex>
	#include <morphinstance_vertex>
	#include <morphnormal_vertex>
	#include <skinbase_vertex>
	#include <skinnormal_vertex>
	#include <defaultnormal_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <worldpos_vertex>
	#include <shadowmap_vertex>
	#include <fog_vertex>
}`,shadow_frag:`uniform vec3 color;
uniform float opacity;
#include <common>
#include <fog_pars_fragment>
#include <bsdfs>
#include <lights_pars_begin>
#include <logdepthbuf_pars_fragment>
#include <shadowmap_pars_fragment>
#include <shadowmask_pars_fragment>
void main() {
	#include <logdepthbuf_fragment>
	gl_FragColor = vec4( color, opacity * ( 1.0 - getShadowMask() ) );
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
}`,sprite_vert:`uniform float rotation;
uniform vec2 center;
#include <common>
#include <uv_pars_vertex>
#include <fog_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	vec4 mvPosition = modelViewMatrix[ 3 ];
	vec2 scale = vec2( length( modelMatrix[ 0 ].xyz ), length( modelMatrix[ 1 ].xyz ) );
	#ifndef USE_SIZEATTENUATION
		bool isPerspective = isPerspectiveMatrix( projectionMatrix );
		if ( isPerspective ) scale *= - mvPosition.z;
	#endif
	vec2 alignedPosition = ( position.xy - ( center - vec2( 0.5 ) ) ) * scale;
	vec2 rotatedPosition;
	rotatedPosition.x = cos( rotation ) * alignedPosition.x - sin( rotation ) * alignedPosition.y;
	rotatedPosition.y = sin( rotation ) * alignedPosition.x + cos( rotation ) * alignedPosition.y;
	mvPosition.xy += rotatedPosition;
	gl_Position = projectionMatrix * mvPosition;
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	#include <fog_vertex>
}`,sprite_frag:`uniform vec3 diffuse;
uniform float opacity;
#include <common>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <fog_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	vec3 outgoingLight = vec3( 0.0 );
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	outgoingLight = diffuseColor.rgb;
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
}`},le={common:{diffuse:{value:new je(16777215)},opacity:{value:1},map:{value:null},mapTransform:{value:new Ue},alphaMap:{value:null},alphaMapTransform:{value:new Ue},alphaTest:{value:0}},specularmap:{specularMap:{value:null},specularMapTransform:{value:new Ue}},envmap:{envMap:{value:null},envMapRotation:{value:new Ue},reflectivity:{value:1},ior:{value:1.5},refractionRatio:{value:.98},dfgLUT:{value:null}},aomap:{aoMap:{value:null},aoMapIntensity:{value:1},aoMapTransform:{value:new Ue}},lightmap:{lightMap:{value:null},lightMapIntensity:{value:1},lightMapTransform:{value:new Ue}},bumpmap:{bumpMap:{value:null},bumpMapTransform:{value:new Ue},bumpScale:{value:1}},normalmap:{normalMap:{value:null},normalMapTransform:{value:new Ue},normalScale:{value:new ne(1,1)}},displacementmap:{displacementMap:{value:null},displacementMapTransform:{value:new Ue},displacementScale:{value:1},displacementBias:{value:0}},emissivemap:{emissiveMap:{value:null},emissiveMapTransform:{value:new Ue}},metalnessmap:{metalnessMap:{value:null},metalnessMapTransform:{value:new Ue}},roughnessmap:{roughnessMap:{value:null},roughnessMapTransform:{value:new Ue}},gradientmap:{gradientMap:{value:null}},fog:{fogDensity:{value:25e-5},fogNear:{value:1},fogFar:{value:2e3},fogColor:{value:new je(16777215)}},lights:{ambientLightColor:{value:[]},lightProbe:{value:[]},directionalLights:{value:[],properties:{direction:{},color:{}}},directionalLightShadows:{value:[],properties:{shadowIntensity:1,shadowBias:{},shadowNormalBias:{},shadowRadius:{},shadowMapSize:{}}},directionalShadowMatrix:{value:[]},spotLights:{value:[],properties:{color:{},position:{},direction:{},distance:{},coneCos:{},penumbraCos:{},decay:{}}},spotLightShadows:{value:[],properties:{shadowIntensity:1,shadowBias:{},shadowNormalBias:{},shadowRadius:{},shadowMapSize:{}}},spotLightMap:{value:[]},spotLightMatrix:{value:[]},pointLights:{value:[],properties:{color:{},position:{},decay:{},distance:{}}},pointLightShadows:{value:[],properties:{shadowIntensity:1,shadowBias:{},shadowNormalBias:{},shadowRadius:{},shadowMapSize:{},shadowCameraNear:{},shadowCameraFar:{}}},pointShadowMatrix:{value:[]},hemisphereLights:{value:[],properties:{direction:{},skyColor:{},groundColor:{}}},rectAreaLights:{value:[],properties:{color:{},position:{},width:{},height:{}}},ltc_1:{value:null},ltc_2:{value:null},probesSH:{value:null},probesMin:{value:new A},probesMax:{value:new A},probesResolution:{value:new A}},points:{diffuse:{value:new je(16777215)},opacity:{value:1},size:{value:1},scale:{value:1},map:{value:null},alphaMap:{value:null},alphaMapTransform:{value:new Ue},alphaTest:{value:0},uvTransform:{value:new Ue}},sprite:{diffuse:{value:new je(16777215)},opacity:{value:1},center:{value:new ne(.5,.5)},rotation:{value:0},map:{value:null},mapTransform:{value:new Ue},alphaMap:{value:null},alphaMapTransform:{value:new Ue},alphaTest:{value:0}}},Pi={basic:{uniforms:Nt([le.common,le.specularmap,le.envmap,le.aomap,le.lightmap,le.fog]),vertexShader:Ne.meshbasic_vert,fragmentShader:Ne.meshbasic_frag},lambert:{uniforms:Nt([le.common,le.specularmap,le.envmap,le.aomap,le.lightmap,le.emissivemap,le.bumpmap,le.normalmap,le.displacementmap,le.fog,le.lights,{emissive:{value:new je(0)},envMapIntensity:{value:1}}]),vertexShader:Ne.meshlambert_vert,fragmentShader:Ne.meshlambert_frag},phong:{uniforms:Nt([le.common,le.specularmap,le.envmap,le.aomap,le.lightmap,le.emissivemap,le.bumpmap,le.normalmap,le.displacementmap,le.fog,le.lights,{emissive:{value:new je(0)},specular:{value:new je(1118481)},shininess:{value:30},envMapIntensity:{value:1}}]),vertexShader:Ne.meshphong_vert,fragmentShader:Ne.meshphong_frag},standard:{uniforms:Nt([le.common,le.envmap,le.aomap,le.lightmap,le.emissivemap,le.bumpmap,le.normalmap,le.displacementmap,le.roughnessmap,le.metalnessmap,le.fog,le.lights,{emissive:{value:new je(0)},roughness:{value:1},metalness:{value:0},envMapIntensity:{value:1}}]),vertexShader:Ne.meshphysical_vert,fragmentShader:Ne.meshphysical_frag},toon:{uniforms:Nt([le.common,le.aomap,le.lightmap,le.emissivemap,le.bumpmap,le.normalmap,le.displacementmap,le.gradientmap,le.fog,le.lights,{emissive:{value:new je(0)}}]),vertexShader:Ne.meshtoon_vert,fragmentShader:Ne.meshtoon_frag},matcap:{uniforms:Nt([le.common,le.bumpmap,le.normalmap,le.displacementmap,le.fog,{matcap:{value:null}}]),vertexShader:Ne.meshmatcap_vert,fragmentShader:Ne.meshmatcap_frag},points:{uniforms:Nt([le.points,le.fog]),vertexShader:Ne.points_vert,fragmentShader:Ne.points_frag},dashed:{uniforms:Nt([le.common,le.fog,{scale:{value:1},dashSize:{value:1},totalSize:{value:2}}]),vertexShader:Ne.linedashed_vert,fragmentShader:Ne.linedashed_frag},depth:{uniforms:Nt([le.common,le.displacementmap]),vertexShader:Ne.depth_vert,fragmentShader:Ne.depth_frag},normal:{uniforms:Nt([le.common,le.bumpmap,le.normalmap,le.displacementmap,{opacity:{value:1}}]),vertexShader:Ne.meshnormal_vert,fragmentShader:Ne.meshnormal_frag},sprite:{uniforms:Nt([le.sprite,le.fog]),vertexShader:Ne.sprite_vert,fragmentShader:Ne.sprite_frag},background:{uniforms:{uvTransform:{value:new Ue},t2D:{value:null},backgroundIntensity:{value:1}},vertexShader:Ne.background_vert,fragmentShader:Ne.background_frag},backgroundCube:{uniforms:{envMap:{value:null},backgroundBlurriness:{value:0},backgroundIntensity:{value:1},backgroundRotation:{value:new Ue}},vertexShader:Ne.backgroundCube_vert,fragmentShader:Ne.backgroundCube_frag},cube:{uniforms:{tCube:{value:null},tFlip:{value:-1},opacity:{value:1}},vertexShader:Ne.cube_vert,fragmentShader:Ne.cube_frag},equirect:{uniforms:{tEquirect:{value:null}},vertexShader:Ne.equirect_vert,fragmentShader:Ne.equirect_frag},distance:{uniforms:Nt([le.common,le.displacementmap,{referencePosition:{value:new A},nearDistance:{value:1},farDistance:{value:1e3}}]),vertexShader:Ne.distance_vert,fragmentShader:Ne.distance_frag},shadow:{uniforms:Nt([le.lights,le.fog,{color:{value:new je(0)},opacity:{value:1}}]),vertexShader:Ne.shadow_vert,fragmentShader:Ne.shadow_frag}};Pi.physical={uniforms:Nt([Pi.standard.uniforms,{clearcoat:{value:0},clearcoatMap:{value:null},clearcoatMapTransform:{value:new Ue},clearcoatNormalMap:{value:null},clearcoatNormalMapTransform:{value:new Ue},clearcoatNormalScale:{value:new ne(1,1)},clearcoatRoughness:{value:0},clearcoatRoughnessMap:{value:null},clearcoatRoughnessMapTransform:{value:new Ue},dispersion:{value:0},iridescence:{value:0},iridescenceMap:{value:null},iridescenceMapTransform:{value:new Ue},iridescenceIOR:{value:1.3},iridescenceThicknessMinimum:{value:100},iridescenceThicknessMaximum:{value:400},iridescenceThicknessMap:{value:null},iridescenceThicknessMapTransform:{value:new Ue},sheen:{value:0},sheenColor:{value:new je(0)},sheenColorMap:{value:null},sheenColorMapTransform:{value:new Ue},sheenRoughness:{value:1},sheenRoughnessMap:{value:null},sheenRoughnessMapTransform:{value:new Ue},transmission:{value:0},transmissionMap:{value:null},transmissionMapTransform:{value:new Ue},transmissionSamplerSize:{value:new ne},transmissionSamplerMap:{value:null},thickness:{value:0},thicknessMap:{value:null},thicknessMapTransform:{value:new Ue},attenuationDistance:{value:0},attenuationColor:{value:new je(0)},specularColor:{value:new je(1,1,1)},specularColorMap:{value:null},specularColorMapTransform:{value:new Ue},specularIntensity:{value:1},specularIntensityMap:{value:null},specularIntensityMapTransform:{value:new Ue},anisotropyVector:{value:new ne},anisotropyMap:{value:null},anisotropyMapTransform:{value:new Ue}}]),vertexShader:Ne.meshphysical_vert,fragmentShader:Ne.meshphysical_frag};var wo={r:0,b:0,g:0},ig=new De,Sp=new Ue;function ng(r,e,t,i,n,s){let a=new je(0),o,l,c=n===!0?0:1,h=null,u=0,f=null;function p(d){let _=d.isScene===!0?d.background:null;if(_&&_.isTexture){let m=d.backgroundBlurriness>0;_=e.get(_,m)}return _}function g(d,_){d.getRGB(wo,nh(r)),t.buffers.color.setClear(wo.r,wo.g,wo.b,_,s)}return{getClearColor:function(){return a},setClearColor:function(d,_=1){a.set(d),c=_,g(a,c)},getClearAlpha:function(){return c},setClearAlpha:function(d){c=d,g(a,c)},render:function(d){let _=!1,m=p(d);m===null?g(a,c):m&&m.isColor&&(g(m,1),_=!0);let v=r.xr.getEnvironmentBlendMode();v==="additive"?t.buffers.color.setClear(0,0,0,1,s):v==="alpha-blend"&&t.buffers.color.setClear(0,0,0,0,s),(r.autoClear||_)&&(t.buffers.depth.setTest(!0),t.buffers.depth.setMask(!0),t.buffers.color.setMask(!0),r.clear(r.autoClearColor,r.autoClearDepth,r.autoClearStencil))},addToRenderList:function(d,_){let m=p(_);m&&(m.isCubeTexture||m.mapping===hs)?(l===void 0&&(l=new Ct(new Tn(1,1,1),new $t({name:"BackgroundCubeMaterial",uniforms:Ln(Pi.backgroundCube.uniforms),vertexShader:Pi.backgroundCube.vertexShader,fragmentShader:Pi.backgroundCube.fragmentShader,side:Wt,depthTest:!1,depthWrite:!1,fog:!1,allowOverride:!1})),l.geometry.deleteAttribute("normal"),l.geometry.deleteAttribute("uv"),l.onBeforeRender=function(v,y,w){this.matrixWorld.copyPosition(w.matrixWorld)},Object.defineProperty(l.material,"envMap",{get:function(){return this.uniforms.envMap.value}}),i.update(l)),l.material.uniforms.envMap.value=m,l.material.uniforms.backgroundBlurriness.value=_.backgroundBlurriness,l.material.uniforms.backgroundIntensity.value=_.backgroundIntensity,l.material.uniforms.backgroundRotation.value.setFromMatrix4(ig.makeRotationFromEuler(_.backgroundRotation)).transpose(),m.isCubeTexture&&m.isRenderTargetTexture===!1&&l.material.uniforms.backgroundRotation.value.premultiply(Sp),l.material.toneMapped=Ve.getTransfer(m.colorSpace)!==Ke,h===m&&u===m.version&&f===r.toneMapping||(l.material.needsUpdate=!0,h=m,u=m.version,f=r.toneMapping),l.layers.enableAll(),d.unshift(l,l.geometry,l.material,0,0,null)):m&&m.isTexture&&(o===void 0&&(o=new Ct(new cr(2,2),new $t({name:"BackgroundMaterial",uniforms:Ln(Pi.background.uniforms),vertexShader:Pi.background.vertexShader,fragmentShader:Pi.background.fragmentShader,side:dr,depthTest:!1,depthWrite:!1,fog:!1,allowOverride:!1})),o.geometry.deleteAttribute("normal"),Object.defineProperty(o.material,"map",{get:function(){return this.uniforms.t2D.value}}),i.update(o)),o.material.uniforms.t2D.value=m,o.material.uniforms.backgroundIntensity.value=_.backgroundIntensity,o.material.toneMapped=Ve.getTransfer(m.colorSpace)!==Ke,m.matrixAutoUpdate===!0&&m.updateMatrix(),o.material.uniforms.uvTransform.value.copy(m.matrix),h===m&&u===m.version&&f===r.toneMapping||(o.material.needsUpdate=!0,h=m,u=m.version,f=r.toneMapping),o.layers.enableAll(),d.unshift(o,o.geometry,o.material,0,0,null))},dispose:function(){l!==void 0&&(l.geometry.dispose(),l.material.dispose(),l=void 0),o!==void 0&&(o.geometry.dispose(),o.material.dispose(),o=void 0)}}}function rg(r,e){let t=r.getParameter(r.MAX_VERTEX_ATTRIBS),i={},n=c(null),s=n,a=!1;function o(m){return r.bindVertexArray(m)}function l(m){return r.deleteVertexArray(m)}function c(m){let v=[],y=[],w=[];for(let E=0;E<t;E++)v[E]=0,y[E]=0,w[E]=0;return{geometry:null,program:null,wireframe:!1,newAttributes:v,enabledAttributes:y,attributeDivisors:w,object:m,attributes:{},index:null}}function h(){let m=s.newAttributes;for(let v=0,y=m.length;v<y;v++)m[v]=0}function u(m){f(m,0)}function f(m,v){let y=s.newAttributes,w=s.enabledAttributes,E=s.attributeDivisors;y[m]=1,w[m]===0&&(r.enableVertexAttribArray(m),w[m]=1),E[m]!==v&&(r.vertexAttribDivisor(m,v),E[m]=v)}function p(){let m=s.newAttributes,v=s.enabledAttributes;for(let y=0,w=v.length;y<w;y++)v[y]!==m[y]&&(r.disableVertexAttribArray(y),v[y]=0)}function g(m,v,y,w,E,M,D){D===!0?r.vertexAttribIPointer(m,v,y,E,M):r.vertexAttribPointer(m,v,y,w,E,M)}function d(){_(),a=!0,s!==n&&(s=n,o(s.object))}function _(){n.geometry=null,n.program=null,n.wireframe=!1}return{setup:function(m,v,y,w,E){let M=!1,D=(function(F,I,P,H){let O=H.wireframe===!0,j=i[I.id];j===void 0&&(j={},i[I.id]=j);let z=F.isInstancedMesh===!0?F.id:0,k=j[z];k===void 0&&(k={},j[z]=k);let q=k[P.id];q===void 0&&(q={},k[P.id]=q);let X=q[O];return X===void 0&&(X=c(r.createVertexArray()),q[O]=X),X})(m,w,y,v);s!==D&&(s=D,o(s.object)),M=(function(F,I,P,H){let O=s.attributes,j=I.attributes,z=0,k=P.getAttributes();for(let q in k)if(k[q].location>=0){let X=O[q],oe=j[q];if(oe===void 0&&(q==="instanceMatrix"&&F.instanceMatrix&&(oe=F.instanceMatrix),q==="instanceColor"&&F.instanceColor&&(oe=F.instanceColor)),X===void 0||X.attribute!==oe||oe&&X.data!==oe.data)return!0;z++}return s.attributesNum!==z||s.index!==H})(m,w,y,E),M&&(function(F,I,P,H){let O={},j=I.attributes,z=0,k=P.getAttributes();for(let q in k)if(k[q].location>=0){let X=j[q];X===void 0&&(q==="instanceMatrix"&&F.instanceMatrix&&(X=F.instanceMatrix),q==="instanceColor"&&F.instanceColor&&(X=F.instanceColor));let oe={};oe.attribute=X,X&&X.data&&(oe.data=X.data),O[q]=oe,z++}s.attributes=O,s.attributesNum=z,s.index=H})(m,w,y,E),E!==null&&e.update(E,r.ELEMENT_ARRAY_BUFFER),(M||a)&&(a=!1,(function(F,I,P,H){h();let O=H.attributes,j=P.getAttributes(),z=I.defaultAttributeValues;for(let k in j){let q=j[k];if(q.location>=0){let X=O[k];if(X===void 0&&(k==="instanceMatrix"&&F.instanceMatrix&&(X=F.instanceMatrix),k==="instanceColor"&&F.instanceColor&&(X=F.instanceColor)),X!==void 0){let oe=X.normalized,ue=X.itemSize,be=e.get(X);if(be===void 0)continue;let ye=be.buffer,xe=be.type,ee=be.bytesPerElement,ae=xe===r.INT||xe===r.UNSIGNED_INT||X.gpuType===po;if(X.isInterleavedBufferAttribute){let ie=X.data,ve=ie.stride,ke=X.offset;if(ie.isInstancedInterleavedBuffer){for(let te=0;te<q.locationSize;te++)f(q.location+te,ie.meshPerAttribute);F.isInstancedMesh!==!0&&H._maxInstanceCount===void 0&&(H._maxInstanceCount=ie.meshPerAttribute*ie.count)}else for(let te=0;te<q.locationSize;te++)u(q.location+te);r.bindBuffer(r.ARRAY_BUFFER,ye);for(let te=0;te<q.locationSize;te++)g(q.location+te,ue/q.locationSize,xe,oe,ve*ee,(ke+ue/q.locationSize*te)*ee,ae)}else{if(X.isInstancedBufferAttribute){for(let ie=0;ie<q.locationSize;ie++)f(q.location+ie,X.meshPerAttribute);F.isInstancedMesh!==!0&&H._maxInstanceCount===void 0&&(H._maxInstanceCount=X.meshPerAttribute*X.count)}else for(let ie=0;ie<q.locationSize;ie++)u(q.location+ie);r.bindBuffer(r.ARRAY_BUFFER,ye);for(let ie=0;ie<q.locationSize;ie++)g(q.location+ie,ue/q.locationSize,xe,oe,ue*ee,ue/q.locationSize*ie*ee,ae)}}else if(z!==void 0){let oe=z[k];if(oe!==void 0)switch(oe.length){case 2:r.vertexAttrib2fv(q.location,oe);break;case 3:r.vertexAttrib3fv(q.location,oe);break;case 4:r.vertexAttrib4fv(q.location,oe);break;default:r.vertexAttrib1fv(q.location,oe)}}}}p()})(m,v,y,w),E!==null&&r.bindBuffer(r.ELEMENT_ARRAY_BUFFER,e.get(E).buffer))},reset:d,resetDefaultState:_,dispose:function(){d();for(let m in i){let v=i[m];for(let y in v){let w=v[y];for(let E in w){let M=w[E];for(let D in M)l(M[D].object),delete M[D];delete w[E]}}delete i[m]}},releaseStatesOfGeometry:function(m){if(i[m.id]===void 0)return;let v=i[m.id];for(let y in v){let w=v[y];for(let E in w){let M=w[E];for(let D in M)l(M[D].object),delete M[D];delete w[E]}}delete i[m.id]},releaseStatesOfObject:function(m){for(let v in i){let y=i[v],w=m.isInstancedMesh===!0?m.id:0,E=y[w];if(E!==void 0){for(let M in E){let D=E[M];for(let F in D)l(D[F].object),delete D[F];delete E[M]}delete y[w],Object.keys(y).length===0&&delete i[v]}}},releaseStatesOfProgram:function(m){for(let v in i){let y=i[v];for(let w in y){let E=y[w];if(E[m.id]===void 0)continue;let M=E[m.id];for(let D in M)l(M[D].object),delete M[D];delete E[m.id]}}},initAttributes:h,enableAttribute:u,disableUnusedAttributes:p}}function sg(r,e,t){let i;this.setMode=function(n){i=n},this.render=function(n,s){r.drawArrays(i,n,s),t.update(s,i,1)},this.renderInstances=function(n,s,a){a!==0&&(r.drawArraysInstanced(i,n,s,a),t.update(s,i,a))},this.renderMultiDraw=function(n,s,a){if(a===0)return;e.get("WEBGL_multi_draw").multiDrawArraysWEBGL(i,n,0,s,0,a);let o=0;for(let l=0;l<a;l++)o+=s[l];t.update(o,i,1)}}function ag(r,e,t,i){let n;function s(h){if(h==="highp"){if(r.getShaderPrecisionFormat(r.VERTEX_SHADER,r.HIGH_FLOAT).precision>0&&r.getShaderPrecisionFormat(r.FRAGMENT_SHADER,r.HIGH_FLOAT).precision>0)return"highp";h="mediump"}return h==="mediump"&&r.getShaderPrecisionFormat(r.VERTEX_SHADER,r.MEDIUM_FLOAT).precision>0&&r.getShaderPrecisionFormat(r.FRAGMENT_SHADER,r.MEDIUM_FLOAT).precision>0?"mediump":"lowp"}let a=t.precision!==void 0?t.precision:"highp",o=s(a);o!==a&&(we("WebGLRenderer:",a,"not supported, using",o,"instead."),a=o);let l=t.logarithmicDepthBuffer===!0,c=t.reversedDepthBuffer===!0&&e.has("EXT_clip_control");return t.reversedDepthBuffer===!0&&c===!1&&we("WebGLRenderer: Unable to use reversed depth buffer due to missing EXT_clip_control extension. Fallback to default depth buffer."),{isWebGL2:!0,getMaxAnisotropy:function(){if(n!==void 0)return n;if(e.has("EXT_texture_filter_anisotropic")===!0){let h=e.get("EXT_texture_filter_anisotropic");n=r.getParameter(h.MAX_TEXTURE_MAX_ANISOTROPY_EXT)}else n=0;return n},getMaxPrecision:s,textureFormatReadable:function(h){return h===Jt||i.convert(h)===r.getParameter(r.IMPLEMENTATION_COLOR_READ_FORMAT)},textureTypeReadable:function(h){let u=h===Ci&&(e.has("EXT_color_buffer_half_float")||e.has("EXT_color_buffer_float"));return!(h!==zt&&i.convert(h)!==r.getParameter(r.IMPLEMENTATION_COLOR_READ_TYPE)&&h!==gi&&!u)},precision:a,logarithmicDepthBuffer:l,reversedDepthBuffer:c,maxTextures:r.getParameter(r.MAX_TEXTURE_IMAGE_UNITS),maxVertexTextures:r.getParameter(r.MAX_VERTEX_TEXTURE_IMAGE_UNITS),maxTextureSize:r.getParameter(r.MAX_TEXTURE_SIZE),maxCubemapSize:r.getParameter(r.MAX_CUBE_MAP_TEXTURE_SIZE),maxAttributes:r.getParameter(r.MAX_VERTEX_ATTRIBS),maxVertexUniforms:r.getParameter(r.MAX_VERTEX_UNIFORM_VECTORS),maxVaryings:r.getParameter(r.MAX_VARYING_VECTORS),maxFragmentUniforms:r.getParameter(r.MAX_FRAGMENT_UNIFORM_VECTORS),maxSamples:r.getParameter(r.MAX_SAMPLES),samples:r.getParameter(r.SAMPLES)}}function og(r){let e=this,t=null,i=0,n=!1,s=!1,a=new wi,o=new Ue,l={value:null,needsUpdate:!1};function c(h,u,f,p){let g=h!==null?h.length:0,d=null;if(g!==0){if(d=l.value,p!==!0||d===null){let _=f+4*g,m=u.matrixWorldInverse;o.getNormalMatrix(m),(d===null||d.length<_)&&(d=new Float32Array(_));for(let v=0,y=f;v!==g;++v,y+=4)a.copy(h[v]).applyMatrix4(m,o),a.normal.toArray(d,y),d[y+3]=a.constant}l.value=d,l.needsUpdate=!0}return e.numPlanes=g,e.numIntersection=0,d}this.uniform=l,this.numPlanes=0,this.numIntersection=0,this.init=function(h,u){let f=h.length!==0||u||i!==0||n;return n=u,i=h.length,f},this.beginShadows=function(){s=!0,c(null)},this.endShadows=function(){s=!1},this.setGlobalState=function(h,u){t=c(h,u,0)},this.setState=function(h,u,f){let p=h.clippingPlanes,g=h.clipIntersection,d=h.clipShadows,_=r.get(h);if(!n||p===null||p.length===0||s&&!d)s?c(null):(function(){l.value!==t&&(l.value=t,l.needsUpdate=i>0),e.numPlanes=i,e.numIntersection=0})();else{let m=s?0:i,v=4*m,y=_.clippingState||null;l.value=y,y=c(p,u,v,f);for(let w=0;w!==v;++w)y[w]=t[w];_.clippingState=y,this.numIntersection=g?this.numPlanes:0,this.numPlanes+=m}}}Sp.set(-1,0,0,0,1,0,0,0,1);var Qd=[.125,.215,.35,.446,.526,.582],ps=20,fs=new os,ep=new je,ah=null,oh=0,lh=0,ch=!1,lg=new A,Eo=class{constructor(e){this._renderer=e,this._pingPongRenderTarget=null,this._lodMax=0,this._cubeSize=0,this._sizeLods=[],this._sigmas=[],this._lodMeshes=[],this._backgroundBox=null,this._cubemapMaterial=null,this._equirectMaterial=null,this._blurMaterial=null,this._ggxMaterial=null}fromScene(e,t=0,i=.1,n=100,s={}){let{size:a=256,position:o=lg}=s;ah=this._renderer.getRenderTarget(),oh=this._renderer.getActiveCubeFace(),lh=this._renderer.getActiveMipmapLevel(),ch=this._renderer.xr.enabled,this._renderer.xr.enabled=!1,this._setSize(a);let l=this._allocateTargets();return l.depthBuffer=!0,this._sceneToCubeUV(e,i,n,l,o),t>0&&this._blur(l,0,0,t),this._applyPMREM(l),this._cleanup(l),l}fromEquirectangular(e,t=null){return this._fromTexture(e,t)}fromCubemap(e,t=null){return this._fromTexture(e,t)}compileCubemapShader(){this._cubemapMaterial===null&&(this._cubemapMaterial=np(),this._compileMaterial(this._cubemapMaterial))}compileEquirectangularShader(){this._equirectMaterial===null&&(this._equirectMaterial=ip(),this._compileMaterial(this._equirectMaterial))}dispose(){this._dispose(),this._cubemapMaterial!==null&&this._cubemapMaterial.dispose(),this._equirectMaterial!==null&&this._equirectMaterial.dispose(),this._backgroundBox!==null&&(this._backgroundBox.geometry.dispose(),this._backgroundBox.material.dispose())}_setSize(e){this._lodMax=Math.floor(Math.log2(e)),this._cubeSize=Math.pow(2,this._lodMax)}_dispose(){this._blurMaterial!==null&&this._blurMaterial.dispose(),this._ggxMaterial!==null&&this._ggxMaterial.dispose(),this._pingPongRenderTarget!==null&&this._pingPongRenderTarget.dispose();for(let e=0;e<this._lodMeshes.length;e++)this._lodMeshes[e].geometry.dispose()}_cleanup(e){this._renderer.setRenderTarget(ah,oh,lh),this._renderer.xr.enabled=ch,e.scissorTest=!1,vr(e,0,0,e.width,e.height)}_fromTexture(e,t){e.mapping===fr||e.mapping===An?this._setSize(e.image.length===0?16:e.image[0].width||e.image[0].image.width):this._setSize(e.image.width/4),ah=this._renderer.getRenderTarget(),oh=this._renderer.getActiveCubeFace(),lh=this._renderer.getActiveMipmapLevel(),ch=this._renderer.xr.enabled,this._renderer.xr.enabled=!1;let i=t||this._allocateTargets();return this._textureToCubeUV(e,i),this._applyPMREM(i),this._cleanup(i),i}_allocateTargets(){let e=3*Math.max(this._cubeSize,112),t=4*this._cubeSize,i={magFilter:wt,minFilter:wt,generateMipmaps:!1,type:Ci,format:Jt,colorSpace:Br,depthBuffer:!1},n=tp(e,t,i);if(this._pingPongRenderTarget===null||this._pingPongRenderTarget.width!==e||this._pingPongRenderTarget.height!==t){this._pingPongRenderTarget!==null&&this._dispose(),this._pingPongRenderTarget=tp(e,t,i);let{_lodMax:s}=this;({lodMeshes:this._lodMeshes,sizeLods:this._sizeLods,sigmas:this._sigmas}=(function(a){let o=[],l=[],c=[],h=a,u=a-4+1+Qd.length;for(let f=0;f<u;f++){let p=Math.pow(2,h);o.push(p);let g=1/p;f>a-4?g=Qd[f-a+4-1]:f===0&&(g=0),l.push(g);let d=1/(p-2),_=-d,m=1+d,v=[_,_,m,_,m,m,_,_,m,m,_,m],y=6,w=6,E=3,M=2,D=1,F=new Float32Array(E*w*y),I=new Float32Array(M*w*y),P=new Float32Array(D*w*y);for(let O=0;O<y;O++){let j=O%3*2/3-1,z=O>2?0:-1,k=[j,z,0,j+2/3,z,0,j+2/3,z+1,0,j,z,0,j+2/3,z+1,0,j,z+1,0];F.set(k,E*w*O),I.set(v,M*w*O);let q=[O,O,O,O,O,O];P.set(q,D*w*O)}let H=new Je;H.setAttribute("position",new Et(F,E)),H.setAttribute("uv",new Et(I,M)),H.setAttribute("faceIndex",new Et(P,D)),c.push(new Ct(H,null)),h>4&&h--}return{lodMeshes:c,sizeLods:o,sigmas:l}})(s)),this._blurMaterial=(function(a,o,l){let c=new Float32Array(ps),h=new A(0,1,0);return new $t({name:"SphericalGaussianBlur",defines:{n:ps,CUBEUV_TEXEL_WIDTH:1/o,CUBEUV_TEXEL_HEIGHT:1/l,CUBEUV_MAX_MIP:`${a}.0`},uniforms:{envMap:{value:null},samples:{value:1},weights:{value:c},latitudinal:{value:!1},dTheta:{value:0},mipInt:{value:0},poleAxis:{value:h}},vertexShader:Ao(),fragmentShader:`

			precision mediump float;
			precision mediump int;

			varying vec3 vOutputDirection;

			uniform sampler2D envMap;
			uniform int samples;
			uniform float weights[ n ];
			uniform bool latitudinal;
			uniform float dTheta;
			uniform float mipInt;
			uniform vec3 poleAxis;

			#define ENVMAP_TYPE_CUBE_UV
			#include <cube_uv_reflection_fragment>

			vec3 getSample( float theta, vec3 axis ) {

				float cosTheta = cos( theta );
				// Rodrigues' axis-angle rotation
				vec3 sampleDirection = vOutputDirection * cosTheta
					+ cross( axis, vOutputDirection ) * sin( theta )
					+ axis * dot( axis, vOutputDirection ) * ( 1.0 - cosTheta );

				return bilinearCubeUV( envMap, sampleDirection, mipInt );

			}

			void main() {

				vec3 axis = latitudinal ? poleAxis : cross( poleAxis, vOutputDirection );

				if ( all( equal( axis, vec3( 0.0 ) ) ) ) {

					axis = vec3( vOutputDirection.z, 0.0, - vOutputDirection.x );

				}

				axis = normalize( axis );

				gl_FragColor = vec4( 0.0, 0.0, 0.0, 1.0 );
				gl_FragColor.rgb += weights[ 0 ] * getSample( 0.0, axis );

				for ( int i = 1; i < n; i++ ) {

					if ( i >= samples ) {

						break;

					}

					float theta = dTheta * float( i );
					gl_FragColor.rgb += weights[ i ] * getSample( -1.0 * theta, axis );
					gl_FragColor.rgb += weights[ i ] * getSample( theta, axis );

				}

			}
		`,blending:ri,depthTest:!1,depthWrite:!1})})(s,e,t),this._ggxMaterial=(function(a,o,l){return new $t({name:"PMREMGGXConvolution",defines:{GGX_SAMPLES:256,CUBEUV_TEXEL_WIDTH:1/o,CUBEUV_TEXEL_HEIGHT:1/l,CUBEUV_MAX_MIP:`${a}.0`},uniforms:{envMap:{value:null},roughness:{value:0},mipInt:{value:0}},vertexShader:Ao(),fragmentShader:`

			precision highp float;
			precision highp int;

			varying vec3 vOutputDirection;

			uniform sampler2D envMap;
			uniform float roughness;
			uniform float mipInt;

			#define ENVMAP_TYPE_CUBE_UV
			#include <cube_uv_reflection_fragment>

			#define PI 3.14159265359

			// Van der Corput radical inverse
			float radicalInverse_VdC(uint bits) {
				bits = (bits << 16u) | (bits >> 16u);
				bits = ((bits & 0x55555555u) << 1u) | ((bits & 0xAAAAAAAAu) >> 1u);
				bits = ((bits & 0x33333333u) << 2u) | ((bits & 0xCCCCCCCCu) >> 2u);
				bits = ((bits & 0x0F0F0F0Fu) << 4u) | ((bits & 0xF0F0F0F0u) >> 4u);
				bits = ((bits & 0x00FF00FFu) << 8u) | ((bits & 0xFF00FF00u) >> 8u);
				return float(bits) * 2.3283064365386963e-10; // / 0x100000000
			}

			// Hammersley sequence
			vec2 hammersley(uint i, uint N) {
				return vec2(float(i) / float(N), radicalInverse_VdC(i));
			}

			// GGX VNDF importance sampling (Eric Heitz 2018)
			// "Sampling the GGX Distribution of Visible Normals"
			// https://jcgt.org/published/0007/04/01/
			vec3 importanceSampleGGX_VNDF(vec2 Xi, vec3 V, float roughness) {
				float alpha = roughness * roughness;

				// Section 4.1: Orthonormal basis
				vec3 T1 = vec3(1.0, 0.0, 0.0);
				vec3 T2 = cross(V, T1);

				// Section 4.2: Parameterization of projected area
				float r = sqrt(Xi.x);
				float phi = 2.0 * PI * Xi.y;
				float t1 = r * cos(phi);
				float t2 = r * sin(phi);
				float s = 0.5 * (1.0 + V.z);
				t2 = (1.0 - s) * sqrt(1.0 - t1 * t1) + s * t2;

				// Section 4.3: Reprojection onto hemisphere
				vec3 Nh = t1 * T1 + t2 * T2 + sqrt(max(0.0, 1.0 - t1 * t1 - t2 * t2)) * V;

				// Section 3.4: Transform back to ellipsoid configuration
				return normalize(vec3(alpha * Nh.x, alpha * Nh.y, max(0.0, Nh.z)));
			}

			void main() {
				vec3 N = normalize(vOutputDirection);
				vec3 V = N; // Assume view direction equals normal for pre-filtering

				vec3 prefilteredColor = vec3(0.0);
				float totalWeight = 0.0;

				// For very low roughness, just sample the environment directly
				if (roughness < 0.001) {
					gl_FragColor = vec4(bilinearCubeUV(envMap, N, mipInt), 1.0);
					return;
				}

				// Tangent space basis for VNDF sampling
				vec3 up = abs(N.z) < 0.999 ? vec3(0.0, 0.0, 1.0) : vec3(1.0, 0.0, 0.0);
				vec3 tangent = normalize(cross(up, N));
				vec3 bitangent = cross(N, tangent);

				for(uint i = 0u; i < uint(GGX_SAMPLES); i++) {
					vec2 Xi = hammersley(i, uint(GGX_SAMPLES));

					// For PMREM, V = N, so in tangent space V is always (0, 0, 1)
					vec3 H_tangent = importanceSampleGGX_VNDF(Xi, vec3(0.0, 0.0, 1.0), roughness);

					// Transform H back to world space
					vec3 H = normalize(tangent * H_tangent.x + bitangent * H_tangent.y + N * H_tangent.z);
					vec3 L = normalize(2.0 * dot(V, H) * H - V);

					float NdotL = max(dot(N, L), 0.0);

					if(NdotL > 0.0) {
						// Sample environment at fixed mip level
						// VNDF importance sampling handles the distribution filtering
						vec3 sampleColor = bilinearCubeUV(envMap, L, mipInt);

						// Weight by NdotL for the split-sum approximation
						// VNDF PDF naturally accounts for the visible microfacet distribution
						prefilteredColor += sampleColor * NdotL;
						totalWeight += NdotL;
					}
				}

				if (totalWeight > 0.0) {
					prefilteredColor = prefilteredColor / totalWeight;
				}

				gl_FragColor = vec4(prefilteredColor, 1.0);
			}
		`,blending:ri,depthTest:!1,depthWrite:!1})})(s,e,t)}return n}_compileMaterial(e){let t=new Ct(new Je,e);this._renderer.compile(t,fs)}_sceneToCubeUV(e,t,i,n,s){let a=new Ht(90,1,t,i),o=[1,-1,1,1,1,1],l=[1,1,1,-1,-1,-1],c=this._renderer,h=c.autoClear,u=c.toneMapping;c.getClearColor(ep),c.toneMapping=mi,c.autoClear=!1,c.state.buffers.depth.getReversed()&&(c.setRenderTarget(n),c.clearDepth(),c.setRenderTarget(null)),this._backgroundBox===null&&(this._backgroundBox=new Ct(new Tn,new jr({name:"PMREM.Background",side:Wt,depthWrite:!1,depthTest:!1})));let f=this._backgroundBox,p=f.material,g=!1,d=e.background;d?d.isColor&&(p.color.copy(d),e.background=null,g=!0):(p.color.copy(ep),g=!0);for(let _=0;_<6;_++){let m=_%3;m===0?(a.up.set(0,o[_],0),a.position.set(s.x,s.y,s.z),a.lookAt(s.x+l[_],s.y,s.z)):m===1?(a.up.set(0,0,o[_]),a.position.set(s.x,s.y,s.z),a.lookAt(s.x,s.y+l[_],s.z)):(a.up.set(0,o[_],0),a.position.set(s.x,s.y,s.z),a.lookAt(s.x,s.y,s.z+l[_]));let v=this._cubeSize;vr(n,m*v,_>2?v:0,v,v),c.setRenderTarget(n),g&&c.render(f,a),c.render(e,a)}c.toneMapping=u,c.autoClear=h,e.background=d}_textureToCubeUV(e,t){let i=this._renderer,n=e.mapping===fr||e.mapping===An;n?(this._cubemapMaterial===null&&(this._cubemapMaterial=np()),this._cubemapMaterial.uniforms.flipEnvMap.value=e.isRenderTargetTexture===!1?-1:1):this._equirectMaterial===null&&(this._equirectMaterial=ip());let s=n?this._cubemapMaterial:this._equirectMaterial,a=this._lodMeshes[0];a.material=s,s.uniforms.envMap.value=e;let o=this._cubeSize;vr(t,0,0,3*o,2*o),i.setRenderTarget(t),i.render(a,fs)}_applyPMREM(e){let t=this._renderer,i=t.autoClear;t.autoClear=!1;let n=this._lodMeshes.length;for(let s=1;s<n;s++)this._applyGGXFilter(e,s-1,s);t.autoClear=i}_applyGGXFilter(e,t,i){let n=this._renderer,s=this._pingPongRenderTarget,a=this._ggxMaterial,o=this._lodMeshes[i];o.material=a;let l=a.uniforms,c=i/(this._lodMeshes.length-1),h=t/(this._lodMeshes.length-1),u=Math.sqrt(c*c-h*h)*(0+1.25*c),{_lodMax:f}=this,p=this._sizeLods[i],g=3*p*(i>f-4?i-f+4:0),d=4*(this._cubeSize-p);l.envMap.value=e.texture,l.roughness.value=u,l.mipInt.value=f-t,vr(s,g,d,3*p,2*p),n.setRenderTarget(s),n.render(o,fs),l.envMap.value=s.texture,l.roughness.value=0,l.mipInt.value=f-i,vr(e,g,d,3*p,2*p),n.setRenderTarget(e),n.render(o,fs)}_blur(e,t,i,n,s){let a=this._pingPongRenderTarget;this._halfBlur(e,a,t,i,n,"latitudinal",s),this._halfBlur(a,e,i,i,n,"longitudinal",s)}_halfBlur(e,t,i,n,s,a,o){let l=this._renderer,c=this._blurMaterial;a!=="latitudinal"&&a!=="longitudinal"&&Te("blur direction must be either latitudinal or longitudinal!");let h=this._lodMeshes[n];h.material=c;let u=c.uniforms,f=this._sizeLods[i]-1,p=isFinite(s)?Math.PI/(2*f):2*Math.PI/39,g=s/p,d=isFinite(s)?1+Math.floor(3*g):ps;d>ps&&we(`sigmaRadians, ${s}, is too large and will clip, as it requested ${d} samples when the maximum is set to 20`);let _=[],m=0;for(let w=0;w<ps;++w){let E=w/g,M=Math.exp(-E*E/2);_.push(M),w===0?m+=M:w<d&&(m+=2*M)}for(let w=0;w<_.length;w++)_[w]=_[w]/m;u.envMap.value=e.texture,u.samples.value=d,u.weights.value=_,u.latitudinal.value=a==="latitudinal",o&&(u.poleAxis.value=o);let{_lodMax:v}=this;u.dTheta.value=p,u.mipInt.value=v-i;let y=this._sizeLods[n];vr(t,3*y*(n>v-4?n-v+4:0),4*(this._cubeSize-y),3*y,2*y),l.setRenderTarget(t),l.render(h,fs)}};function tp(r,e,t){let i=new kt(r,e,t);return i.texture.mapping=hs,i.texture.name="PMREM.cubeUv",i.scissorTest=!0,i}function vr(r,e,t,i,n){r.viewport.set(e,t,i,n),r.scissor.set(e,t,i,n)}function ip(){return new $t({name:"EquirectangularToCubeUV",uniforms:{envMap:{value:null}},vertexShader:Ao(),fragmentShader:`

			precision mediump float;
			precision mediump int;

			varying vec3 vOutputDirection;

			uniform sampler2D envMap;

			#include <common>

			void main() {

				vec3 outputDirection = normalize( vOutputDirection );
				vec2 uv = equirectUv( outputDirection );

				gl_FragColor = vec4( texture2D ( envMap, uv ).rgb, 1.0 );

			}
		`,blending:ri,depthTest:!1,depthWrite:!1})}function np(){return new $t({name:"CubemapToCubeUV",uniforms:{envMap:{value:null},flipEnvMap:{value:-1}},vertexShader:Ao(),fragmentShader:`

			precision mediump float;
			precision mediump int;

			uniform float flipEnvMap;

			varying vec3 vOutputDirection;

			uniform samplerCube envMap;

			void main() {

				gl_FragColor = textureCube( envMap, vec3( flipEnvMap * vOutputDirection.x, vOutputDirection.yz ) );

			}
		`,blending:ri,depthTest:!1,depthWrite:!1})}function Ao(){return`

		precision mediump float;
		precision mediump int;

		attribute float faceIndex;

		varying vec3 vOutputDirection;

		// RH coordinate system; PMREM face-indexing convention
		vec3 getDirection( vec2 uv, float face ) {

			uv = 2.0 * uv - 1.0;

			vec3 direction = vec3( uv, 1.0 );

			if ( face == 0.0 ) {

				direction = direction.zyx; // ( 1, v, u ) pos x

			} else if ( face == 1.0 ) {

				direction = direction.xzy;
				direction.xz *= -1.0; // ( -u, 1, -v ) pos y

			} else if ( face == 2.0 ) {

				direction.x *= -1.0; // ( -u, v, 1 ) pos z

			} else if ( face == 3.0 ) {

				direction = direction.zyx;
				direction.xz *= -1.0; // ( -1, v, -u ) neg x

			} else if ( face == 4.0 ) {

				direction = direction.xzy;
				direction.xy *= -1.0; // ( -u, -1, v ) neg y

			} else if ( face == 5.0 ) {

				direction.z *= -1.0; // ( u, v, -1 ) neg z

			}

			return direction;

		}

		void main() {

			vOutputDirection = getDirection( uv, faceIndex );
			gl_Position = vec4( position, 1.0 );

		}
	`}var Co=class extends kt{constructor(e=1,t={}){super(e,e,t),this.isWebGLCubeRenderTarget=!0;let i={width:e,height:e,depth:1},n=[i,i,i,i,i,i];this.texture=new qr(n),this._setTextureOptions(t),this.texture.isRenderTargetTexture=!0}fromEquirectangularTexture(e,t){this.texture.type=t.type,this.texture.colorSpace=t.colorSpace,this.texture.generateMipmaps=t.generateMipmaps,this.texture.minFilter=t.minFilter,this.texture.magFilter=t.magFilter;let i={uniforms:{tEquirect:{value:null}},vertexShader:`

				varying vec3 vWorldDirection;

				vec3 transformDirection( in vec3 dir, in mat4 matrix ) {

					return normalize( ( matrix * vec4( dir, 0.0 ) ).xyz );

				}

				void main() {

					vWorldDirection = transformDirection( position, modelMatrix );

					#include <begin_vertex>
					#include <project_vertex>

				}
			`,fragmentShader:`

				uniform sampler2D tEquirect;

				varying vec3 vWorldDirection;

				#include <common>

				void main() {

					vec3 direction = normalize( vWorldDirection );

					vec2 sampleUV = equirectUv( direction );

					gl_FragColor = texture2D( tEquirect, sampleUV );

				}
			`},n=new Tn(5,5,5),s=new $t({name:"CubemapFromEquirect",uniforms:Ln(i.uniforms),vertexShader:i.vertexShader,fragmentShader:i.fragmentShader,side:Wt,blending:ri});s.uniforms.tEquirect.value=t;let a=new Ct(n,s),o=t.minFilter;return t.minFilter===Cn&&(t.minFilter=wt),new ao(1,10,this).update(e,a),t.minFilter=o,a.geometry.dispose(),a.material.dispose(),this}clear(e,t=!0,i=!0,n=!0){let s=e.getRenderTarget();for(let a=0;a<6;a++)e.setRenderTarget(this,a),e.clear(t,i,n);e.setRenderTarget(s)}};function cg(r){let e=new WeakMap,t=new WeakMap,i=null;function n(o,l){return l===co?o.mapping=fr:l===ho&&(o.mapping=An),o}function s(o){let l=o.target;l.removeEventListener("dispose",s);let c=e.get(l);c!==void 0&&(e.delete(l),c.dispose())}function a(o){let l=o.target;l.removeEventListener("dispose",a);let c=t.get(l);c!==void 0&&(t.delete(l),c.dispose())}return{get:function(o,l=!1){return o==null?null:l?(function(c){if(c&&c.isTexture){let h=c.mapping,u=h===co||h===ho,f=h===fr||h===An;if(u||f){let p=t.get(c),g=p!==void 0?p.texture.pmremVersion:0;if(c.isRenderTargetTexture&&c.pmremVersion!==g)return i===null&&(i=new Eo(r)),p=u?i.fromEquirectangular(c,p):i.fromCubemap(c,p),p.texture.pmremVersion=c.pmremVersion,t.set(c,p),p.texture;if(p!==void 0)return p.texture;{let d=c.image;return u&&d&&d.height>0||f&&d&&(function(_){let m=0,v=6;for(let y=0;y<v;y++)_[y]!==void 0&&m++;return m===v})(d)?(i===null&&(i=new Eo(r)),p=u?i.fromEquirectangular(c):i.fromCubemap(c),p.texture.pmremVersion=c.pmremVersion,t.set(c,p),c.addEventListener("dispose",a),p.texture):null}}}return c})(o):(function(c){if(c&&c.isTexture){let h=c.mapping;if(h===co||h===ho){if(e.has(c))return n(e.get(c).texture,c.mapping);{let u=c.image;if(u&&u.height>0){let f=new Co(u.height);return f.fromEquirectangularTexture(r,c),e.set(c,f),c.addEventListener("dispose",s),n(f.texture,c.mapping)}return null}}}return c})(o)},dispose:function(){e=new WeakMap,t=new WeakMap,i!==null&&(i.dispose(),i=null)}}}function hg(r){let e={};function t(i){if(e[i]!==void 0)return e[i];let n=r.getExtension(i);return e[i]=n,n}return{has:function(i){return t(i)!==null},init:function(){t("EXT_color_buffer_float"),t("WEBGL_clip_cull_distance"),t("OES_texture_float_linear"),t("EXT_color_buffer_half_float"),t("WEBGL_multisampled_render_to_texture"),t("WEBGL_render_shared_exponent")},get:function(i){let n=t(i);return n===null&&_a("WebGLRenderer: "+i+" extension not supported."),n}}}function ug(r,e,t,i){let n={},s=new WeakMap;function a(l){let c=l.target;c.index!==null&&e.remove(c.index);for(let u in c.attributes)e.remove(c.attributes[u]);c.removeEventListener("dispose",a),delete n[c.id];let h=s.get(c);h&&(e.remove(h),s.delete(c)),i.releaseStatesOfGeometry(c),c.isInstancedBufferGeometry===!0&&delete c._maxInstanceCount,t.memory.geometries--}function o(l){let c=[],h=l.index,u=l.attributes.position,f=0;if(u===void 0)return;if(h!==null){let d=h.array;f=h.version;for(let _=0,m=d.length;_<m;_+=3){let v=d[_+0],y=d[_+1],w=d[_+2];c.push(v,y,y,w,w,v)}}else{let d=u.array;f=u.version;for(let _=0,m=d.length/3-1;_<m;_+=3){let v=_+0,y=_+1,w=_+2;c.push(v,y,y,w,w,v)}}let p=new(u.count>=65535?Xr:Wr)(c,1);p.version=f;let g=s.get(l);g&&e.remove(g),s.set(l,p)}return{get:function(l,c){return n[c.id]===!0||(c.addEventListener("dispose",a),n[c.id]=!0,t.memory.geometries++),c},update:function(l){let c=l.attributes;for(let h in c)e.update(c[h],r.ARRAY_BUFFER)},getWireframeAttribute:function(l){let c=s.get(l);if(c){let h=l.index;h!==null&&c.version<h.version&&o(l)}else o(l);return s.get(l)}}}function dg(r,e,t){let i,n,s;this.setMode=function(a){i=a},this.setIndex=function(a){n=a.type,s=a.bytesPerElement},this.render=function(a,o){r.drawElements(i,o,n,a*s),t.update(o,i,1)},this.renderInstances=function(a,o,l){l!==0&&(r.drawElementsInstanced(i,o,n,a*s,l),t.update(o,i,l))},this.renderMultiDraw=function(a,o,l){if(l===0)return;e.get("WEBGL_multi_draw").multiDrawElementsWEBGL(i,o,0,n,a,0,l);let c=0;for(let h=0;h<l;h++)c+=o[h];t.update(c,i,1)}}function pg(r){let e={frame:0,calls:0,triangles:0,points:0,lines:0};return{memory:{geometries:0,textures:0},render:e,programs:null,autoReset:!0,reset:function(){e.calls=0,e.triangles=0,e.points=0,e.lines=0},update:function(t,i,n){switch(e.calls++,i){case r.TRIANGLES:e.triangles+=n*(t/3);break;case r.LINES:e.lines+=n*(t/2);break;case r.LINE_STRIP:e.lines+=n*(t-1);break;case r.LINE_LOOP:e.lines+=n*t;break;case r.POINTS:e.points+=n*t;break;default:Te("WebGLInfo: Unknown draw mode:",i)}}}}function fg(r,e,t){let i=new WeakMap,n=new $e;return{update:function(s,a,o){let l=s.morphTargetInfluences,c=a.morphAttributes.position||a.morphAttributes.normal||a.morphAttributes.color,h=c!==void 0?c.length:0,u=i.get(a);if(u===void 0||u.count!==h){let F=function(){M.dispose(),i.delete(a),a.removeEventListener("dispose",F)};u!==void 0&&u.texture.dispose();let f=a.morphAttributes.position!==void 0,p=a.morphAttributes.normal!==void 0,g=a.morphAttributes.color!==void 0,d=a.morphAttributes.position||[],_=a.morphAttributes.normal||[],m=a.morphAttributes.color||[],v=0;f===!0&&(v=1),p===!0&&(v=2),g===!0&&(v=3);let y=a.attributes.position.count*v,w=1;y>e.maxTextureSize&&(w=Math.ceil(y/e.maxTextureSize),y=e.maxTextureSize);let E=new Float32Array(y*w*4*h),M=new Vr(E,y,w,h);M.type=gi,M.needsUpdate=!0;let D=4*v;for(let I=0;I<h;I++){let P=d[I],H=_[I],O=m[I],j=y*w*4*I;for(let z=0;z<P.count;z++){let k=z*D;f===!0&&(n.fromBufferAttribute(P,z),E[j+k+0]=n.x,E[j+k+1]=n.y,E[j+k+2]=n.z,E[j+k+3]=0),p===!0&&(n.fromBufferAttribute(H,z),E[j+k+4]=n.x,E[j+k+5]=n.y,E[j+k+6]=n.z,E[j+k+7]=0),g===!0&&(n.fromBufferAttribute(O,z),E[j+k+8]=n.x,E[j+k+9]=n.y,E[j+k+10]=n.z,E[j+k+11]=O.itemSize===4?n.w:1)}}u={count:h,texture:M,size:new ne(y,w)},i.set(a,u),a.addEventListener("dispose",F)}if(s.isInstancedMesh===!0&&s.morphTexture!==null)o.getUniforms().setValue(r,"morphTexture",s.morphTexture,t);else{let f=0;for(let g=0;g<l.length;g++)f+=l[g];let p=a.morphTargetsRelative?1:1-f;o.getUniforms().setValue(r,"morphTargetBaseInfluence",p),o.getUniforms().setValue(r,"morphTargetInfluences",l)}o.getUniforms().setValue(r,"morphTargetsTexture",u.texture,t),o.getUniforms().setValue(r,"morphTargetsTextureSize",u.size)}}}function mg(r,e,t,i,n){let s=new WeakMap;function a(o){let l=o.target;l.removeEventListener("dispose",a),i.releaseStatesOfObject(l),t.remove(l.instanceMatrix),l.instanceColor!==null&&t.remove(l.instanceColor)}return{update:function(o){let l=n.render.frame,c=o.geometry,h=e.get(o,c);if(s.get(h)!==l&&(e.update(h),s.set(h,l)),o.isInstancedMesh&&(o.hasEventListener("dispose",a)===!1&&o.addEventListener("dispose",a),s.get(o)!==l&&(t.update(o.instanceMatrix,r.ARRAY_BUFFER),o.instanceColor!==null&&t.update(o.instanceColor,r.ARRAY_BUFFER),s.set(o,l))),o.isSkinnedMesh){let u=o.skeleton;s.get(u)!==l&&(u.update(),s.set(u,l))}return h},dispose:function(){s=new WeakMap}}}var gg={[cc]:"LINEAR_TONE_MAPPING",[hc]:"REINHARD_TONE_MAPPING",[uc]:"CINEON_TONE_MAPPING",[dc]:"ACES_FILMIC_TONE_MAPPING",[fc]:"AGX_TONE_MAPPING",[mc]:"NEUTRAL_TONE_MAPPING",[pc]:"CUSTOM_TONE_MAPPING"};function vg(r,e,t,i,n){let s=new kt(e,t,{type:r,depthBuffer:i,stencilBuffer:n,depthTexture:i?new Gi(e,t):void 0}),a=new kt(e,t,{type:Ci,depthBuffer:!1,stencilBuffer:!1}),o=new Je;o.setAttribute("position",new Ae([-1,3,0,-1,-1,0,3,-1,0],3)),o.setAttribute("uv",new Ae([0,2,0,0,2,0],2));let l=new hr({uniforms:{tDiffuse:{value:null}},vertexShader:`
			precision highp float;

			uniform mat4 modelViewMatrix;
			uniform mat4 projectionMatrix;

			attribute vec3 position;
			attribute vec2 uv;

			varying vec2 vUv;

			void main() {
				vUv = uv;
				gl_Position = projectionMatrix * modelViewMatrix * vec4( position, 1.0 );
			}`,fragmentShader:`
			precision highp float;

			uniform sampler2D tDiffuse;

			varying vec2 vUv;

			#include <tonemapping_pars_fragment>
			#include <colorspace_pars_fragment>

			void main() {
				gl_FragColor = texture2D( tDiffuse, vUv );

				#ifdef LINEAR_TONE_MAPPING
					gl_FragColor.rgb = LinearToneMapping( gl_FragColor.rgb );
				#elif defined( REINHARD_TONE_MAPPING )
					gl_FragColor.rgb = ReinhardToneMapping( gl_FragColor.rgb );
				#elif defined( CINEON_TONE_MAPPING )
					gl_FragColor.rgb = CineonToneMapping( gl_FragColor.rgb );
				#elif defined( ACES_FILMIC_TONE_MAPPING )
					gl_FragColor.rgb = ACESFilmicToneMapping( gl_FragColor.rgb );
				#elif defined( AGX_TONE_MAPPING )
					gl_FragColor.rgb = AgXToneMapping( gl_FragColor.rgb );
				#elif defined( NEUTRAL_TONE_MAPPING )
					gl_FragColor.rgb = NeutralToneMapping( gl_FragColor.rgb );
				#elif defined( CUSTOM_TONE_MAPPING )
					gl_FragColor.rgb = CustomToneMapping( gl_FragColor.rgb );
				#endif

				#ifdef SRGB_TRANSFER
					gl_FragColor = sRGBTransferOETF( gl_FragColor );
				#endif
			}`,depthTest:!1,depthWrite:!1}),c=new Ct(o,l),h=new os(-1,1,1,-1,0,1),u,f=null,p=null,g=!1,d=null,_=[],m=!1;this.setSize=function(v,y){s.setSize(v,y),a.setSize(v,y);for(let w=0;w<_.length;w++){let E=_[w];E.setSize&&E.setSize(v,y)}},this.setEffects=function(v){_=v,m=_.length>0&&_[0].isRenderPass===!0;let y=s.width,w=s.height;for(let E=0;E<_.length;E++){let M=_[E];M.setSize&&M.setSize(y,w)}},this.begin=function(v,y){if(g||v.toneMapping===mi&&_.length===0)return!1;if(d=y,y!==null){let w=y.width,E=y.height;s.width===w&&s.height===E||this.setSize(w,E)}return m===!1&&v.setRenderTarget(s),u=v.toneMapping,v.toneMapping=mi,!0},this.hasRenderPass=function(){return m},this.end=function(v,y){v.toneMapping=u,g=!0;let w=s,E=a;for(let M=0;M<_.length;M++){let D=_[M];if(D.enabled!==!1&&(D.render(v,E,w,y),D.needsSwap!==!1)){let F=w;w=E,E=F}}if(f!==v.outputColorSpace||p!==v.toneMapping){f=v.outputColorSpace,p=v.toneMapping,l.defines={},Ve.getTransfer(f)===Ke&&(l.defines.SRGB_TRANSFER="");let M=gg[p];M&&(l.defines[M]=""),l.needsUpdate=!0}l.uniforms.tDiffuse.value=w.texture,v.setRenderTarget(d),v.render(c,h),d=null,g=!1},this.isCompositing=function(){return g},this.dispose=function(){s.depthTexture&&s.depthTexture.dispose(),s.dispose(),a.dispose(),o.dispose(),l.dispose()}}var bp=new Dt,dh=new Gi(1,1),wp=new Vr,Tp=new Sa,Ep=new qr,rp=[],sp=[],ap=new Float32Array(16),op=new Float32Array(9),lp=new Float32Array(4);function xr(r,e,t){let i=r[0];if(i<=0||i>0)return r;let n=e*t,s=rp[n];if(s===void 0&&(s=new Float32Array(n),rp[n]=s),e!==0){i.toArray(s,0);for(let a=1,o=0;a!==e;++a)o+=t,r[a].toArray(s,o)}return s}function Mt(r,e){if(r.length!==e.length)return!1;for(let t=0,i=r.length;t<i;t++)if(r[t]!==e[t])return!1;return!0}function St(r,e){for(let t=0,i=e.length;t<i;t++)r[t]=e[t]}function Io(r,e){let t=sp[e];t===void 0&&(t=new Int32Array(e),sp[e]=t);for(let i=0;i!==e;++i)t[i]=r.allocateTextureUnit();return t}function _g(r,e){let t=this.cache;t[0]!==e&&(r.uniform1f(this.addr,e),t[0]=e)}function xg(r,e){let t=this.cache;if(e.x!==void 0)t[0]===e.x&&t[1]===e.y||(r.uniform2f(this.addr,e.x,e.y),t[0]=e.x,t[1]=e.y);else{if(Mt(t,e))return;r.uniform2fv(this.addr,e),St(t,e)}}function yg(r,e){let t=this.cache;if(e.x!==void 0)t[0]===e.x&&t[1]===e.y&&t[2]===e.z||(r.uniform3f(this.addr,e.x,e.y,e.z),t[0]=e.x,t[1]=e.y,t[2]=e.z);else if(e.r!==void 0)t[0]===e.r&&t[1]===e.g&&t[2]===e.b||(r.uniform3f(this.addr,e.r,e.g,e.b),t[0]=e.r,t[1]=e.g,t[2]=e.b);else{if(Mt(t,e))return;r.uniform3fv(this.addr,e),St(t,e)}}function Mg(r,e){let t=this.cache;if(e.x!==void 0)t[0]===e.x&&t[1]===e.y&&t[2]===e.z&&t[3]===e.w||(r.uniform4f(this.addr,e.x,e.y,e.z,e.w),t[0]=e.x,t[1]=e.y,t[2]=e.z,t[3]=e.w);else{if(Mt(t,e))return;r.uniform4fv(this.addr,e),St(t,e)}}function Sg(r,e){let t=this.cache,i=e.elements;if(i===void 0){if(Mt(t,e))return;r.uniformMatrix2fv(this.addr,!1,e),St(t,e)}else{if(Mt(t,i))return;lp.set(i),r.uniformMatrix2fv(this.addr,!1,lp),St(t,i)}}function bg(r,e){let t=this.cache,i=e.elements;if(i===void 0){if(Mt(t,e))return;r.uniformMatrix3fv(this.addr,!1,e),St(t,e)}else{if(Mt(t,i))return;op.set(i),r.uniformMatrix3fv(this.addr,!1,op),St(t,i)}}function wg(r,e){let t=this.cache,i=e.elements;if(i===void 0){if(Mt(t,e))return;r.uniformMatrix4fv(this.addr,!1,e),St(t,e)}else{if(Mt(t,i))return;ap.set(i),r.uniformMatrix4fv(this.addr,!1,ap),St(t,i)}}function Tg(r,e){let t=this.cache;t[0]!==e&&(r.uniform1i(this.addr,e),t[0]=e)}function Eg(r,e){let t=this.cache;if(e.x!==void 0)t[0]===e.x&&t[1]===e.y||(r.uniform2i(this.addr,e.x,e.y),t[0]=e.x,t[1]=e.y);else{if(Mt(t,e))return;r.uniform2iv(this.addr,e),St(t,e)}}function Ag(r,e){let t=this.cache;if(e.x!==void 0)t[0]===e.x&&t[1]===e.y&&t[2]===e.z||(r.uniform3i(this.addr,e.x,e.y,e.z),t[0]=e.x,t[1]=e.y,t[2]=e.z);else{if(Mt(t,e))return;r.uniform3iv(this.addr,e),St(t,e)}}function Cg(r,e){let t=this.cache;if(e.x!==void 0)t[0]===e.x&&t[1]===e.y&&t[2]===e.z&&t[3]===e.w||(r.uniform4i(this.addr,e.x,e.y,e.z,e.w),t[0]=e.x,t[1]=e.y,t[2]=e.z,t[3]=e.w);else{if(Mt(t,e))return;r.uniform4iv(this.addr,e),St(t,e)}}function Rg(r,e){let t=this.cache;t[0]!==e&&(r.uniform1ui(this.addr,e),t[0]=e)}function Ig(r,e){let t=this.cache;if(e.x!==void 0)t[0]===e.x&&t[1]===e.y||(r.uniform2ui(this.addr,e.x,e.y),t[0]=e.x,t[1]=e.y);else{if(Mt(t,e))return;r.uniform2uiv(this.addr,e),St(t,e)}}function Pg(r,e){let t=this.cache;if(e.x!==void 0)t[0]===e.x&&t[1]===e.y&&t[2]===e.z||(r.uniform3ui(this.addr,e.x,e.y,e.z),t[0]=e.x,t[1]=e.y,t[2]=e.z);else{if(Mt(t,e))return;r.uniform3uiv(this.addr,e),St(t,e)}}function Lg(r,e){let t=this.cache;if(e.x!==void 0)t[0]===e.x&&t[1]===e.y&&t[2]===e.z&&t[3]===e.w||(r.uniform4ui(this.addr,e.x,e.y,e.z,e.w),t[0]=e.x,t[1]=e.y,t[2]=e.z,t[3]=e.w);else{if(Mt(t,e))return;r.uniform4uiv(this.addr,e),St(t,e)}}function Ug(r,e,t){let i=this.cache,n=t.allocateTextureUnit(),s;i[0]!==n&&(r.uniform1i(this.addr,n),i[0]=n),this.type===r.SAMPLER_2D_SHADOW?(dh.compareFunction=t.isReversedDepthBuffer()?bo:So,s=dh):s=bp,t.setTexture2D(e||s,n)}function Dg(r,e,t){let i=this.cache,n=t.allocateTextureUnit();i[0]!==n&&(r.uniform1i(this.addr,n),i[0]=n),t.setTexture3D(e||Tp,n)}function Ng(r,e,t){let i=this.cache,n=t.allocateTextureUnit();i[0]!==n&&(r.uniform1i(this.addr,n),i[0]=n),t.setTextureCube(e||Ep,n)}function Fg(r,e,t){let i=this.cache,n=t.allocateTextureUnit();i[0]!==n&&(r.uniform1i(this.addr,n),i[0]=n),t.setTexture2DArray(e||wp,n)}function Og(r,e){r.uniform1fv(this.addr,e)}function Bg(r,e){let t=xr(e,this.size,2);r.uniform2fv(this.addr,t)}function kg(r,e){let t=xr(e,this.size,3);r.uniform3fv(this.addr,t)}function zg(r,e){let t=xr(e,this.size,4);r.uniform4fv(this.addr,t)}function Gg(r,e){let t=xr(e,this.size,4);r.uniformMatrix2fv(this.addr,!1,t)}function Vg(r,e){let t=xr(e,this.size,9);r.uniformMatrix3fv(this.addr,!1,t)}function Hg(r,e){let t=xr(e,this.size,16);r.uniformMatrix4fv(this.addr,!1,t)}function Wg(r,e){r.uniform1iv(this.addr,e)}function Xg(r,e){r.uniform2iv(this.addr,e)}function jg(r,e){r.uniform3iv(this.addr,e)}function qg(r,e){r.uniform4iv(this.addr,e)}function Yg(r,e){r.uniform1uiv(this.addr,e)}function Zg(r,e){r.uniform2uiv(this.addr,e)}function Kg(r,e){r.uniform3uiv(this.addr,e)}function $g(r,e){r.uniform4uiv(this.addr,e)}function Jg(r,e,t){let i=this.cache,n=e.length,s=Io(t,n),a;Mt(i,s)||(r.uniform1iv(this.addr,s),St(i,s)),a=this.type===r.SAMPLER_2D_SHADOW?dh:bp;for(let o=0;o!==n;++o)t.setTexture2D(e[o]||a,s[o])}function Qg(r,e,t){let i=this.cache,n=e.length,s=Io(t,n);Mt(i,s)||(r.uniform1iv(this.addr,s),St(i,s));for(let a=0;a!==n;++a)t.setTexture3D(e[a]||Tp,s[a])}function e0(r,e,t){let i=this.cache,n=e.length,s=Io(t,n);Mt(i,s)||(r.uniform1iv(this.addr,s),St(i,s));for(let a=0;a!==n;++a)t.setTextureCube(e[a]||Ep,s[a])}function t0(r,e,t){let i=this.cache,n=e.length,s=Io(t,n);Mt(i,s)||(r.uniform1iv(this.addr,s),St(i,s));for(let a=0;a!==n;++a)t.setTexture2DArray(e[a]||wp,s[a])}var ph=class{constructor(e,t,i){this.id=e,this.addr=i,this.cache=[],this.type=t.type,this.setValue=(function(n){switch(n){case 5126:return _g;case 35664:return xg;case 35665:return yg;case 35666:return Mg;case 35674:return Sg;case 35675:return bg;case 35676:return wg;case 5124:case 35670:return Tg;case 35667:case 35671:return Eg;case 35668:case 35672:return Ag;case 35669:case 35673:return Cg;case 5125:return Rg;case 36294:return Ig;case 36295:return Pg;case 36296:return Lg;case 35678:case 36198:case 36298:case 36306:case 35682:return Ug;case 35679:case 36299:case 36307:return Dg;case 35680:case 36300:case 36308:case 36293:return Ng;case 36289:case 36303:case 36311:case 36292:return Fg}})(t.type)}},fh=class{constructor(e,t,i){this.id=e,this.addr=i,this.cache=[],this.type=t.type,this.size=t.size,this.setValue=(function(n){switch(n){case 5126:return Og;case 35664:return Bg;case 35665:return kg;case 35666:return zg;case 35674:return Gg;case 35675:return Vg;case 35676:return Hg;case 5124:case 35670:return Wg;case 35667:case 35671:return Xg;case 35668:case 35672:return jg;case 35669:case 35673:return qg;case 5125:return Yg;case 36294:return Zg;case 36295:return Kg;case 36296:return $g;case 35678:case 36198:case 36298:case 36306:case 35682:return Jg;case 35679:case 36299:case 36307:return Qg;case 35680:case 36300:case 36308:case 36293:return e0;case 36289:case 36303:case 36311:case 36292:return t0}})(t.type)}},mh=class{constructor(e){this.id=e,this.seq=[],this.map={}}setValue(e,t,i){let n=this.seq;for(let s=0,a=n.length;s!==a;++s){let o=n[s];o.setValue(e,t[o.id],i)}}},hh=/(\w+)(\])?(\[|\.)?/g;function cp(r,e){r.seq.push(e),r.map[e.id]=e}function i0(r,e,t){let i=r.name,n=i.length;for(hh.lastIndex=0;;){let s=hh.exec(i),a=hh.lastIndex,o=s[1],l=s[2]==="]",c=s[3];if(l&&(o|=0),c===void 0||c==="["&&a+2===n){cp(t,c===void 0?new ph(o,r,e):new fh(o,r,e));break}{let h=t.map[o];h===void 0&&(h=new mh(o),cp(t,h)),t=h}}}var _r=class{constructor(e,t){this.seq=[],this.map={};let i=e.getProgramParameter(t,e.ACTIVE_UNIFORMS);for(let a=0;a<i;++a){let o=e.getActiveUniform(t,a);i0(o,e.getUniformLocation(t,o.name),this)}let n=[],s=[];for(let a of this.seq)a.type===e.SAMPLER_2D_SHADOW||a.type===e.SAMPLER_CUBE_SHADOW||a.type===e.SAMPLER_2D_ARRAY_SHADOW?n.push(a):s.push(a);n.length>0&&(this.seq=n.concat(s))}setValue(e,t,i,n){let s=this.map[t];s!==void 0&&s.setValue(e,i,n)}setOptional(e,t,i){let n=t[i];n!==void 0&&this.setValue(e,i,n)}static upload(e,t,i,n){for(let s=0,a=t.length;s!==a;++s){let o=t[s],l=i[o.id];l.needsUpdate!==!1&&o.setValue(e,l.value,n)}}static seqWithValue(e,t){let i=[];for(let n=0,s=e.length;n!==s;++n){let a=e[n];a.id in t&&i.push(a)}return i}};function hp(r,e,t){let i=r.createShader(e);return r.shaderSource(i,t),r.compileShader(i),i}var n0=0,up=new Ue;function dp(r,e,t){let i=r.getShaderParameter(e,r.COMPILE_STATUS),n=(r.getShaderInfoLog(e)||"").trim();if(i&&n==="")return"";let s=/ERROR: 0:(\d+)/.exec(n);if(s){let a=parseInt(s[1]);return t.toUpperCase()+`

`+n+`

`+(function(o,l){let c=o.split(`
`),h=[],u=Math.max(l-6,0),f=Math.min(l+6,c.length);for(let p=u;p<f;p++){let g=p+1;h.push(`${g===l?">":" "} ${g}: ${c[p]}`)}return h.join(`
`)})(r.getShaderSource(e),a)}return n}function r0(r,e){let t=(function(i){Ve._getMatrix(up,Ve.workingColorSpace,i);let n=`mat3( ${up.elements.map(s=>s.toFixed(4))} )`;switch(Ve.getTransfer(i)){case kr:return[n,"LinearTransferOETF"];case Ke:return[n,"sRGBTransferOETF"];default:return we("WebGLProgram: Unsupported color space: ",i),[n,"LinearTransferOETF"]}})(e);return[`vec4 ${r}( vec4 value ) {`,`	return ${t[1]}( vec4( value.rgb * ${t[0]}, value.a ) );`,"}"].join(`
`)}var s0={[cc]:"Linear",[hc]:"Reinhard",[uc]:"Cineon",[dc]:"ACESFilmic",[fc]:"AgX",[mc]:"Neutral",[pc]:"Custom"};function a0(r,e){let t=s0[e];return t===void 0?(we("WebGLProgram: Unsupported toneMapping:",e),"vec3 "+r+"( vec3 color ) { return LinearToneMapping( color ); }"):"vec3 "+r+"( vec3 color ) { return "+t+"ToneMapping( color ); }"}var To=new A;function o0(){return Ve.getLuminanceCoefficients(To),["float luminance( const in vec3 rgb ) {",`	const vec3 weights = vec3( ${To.x.toFixed(4)}, ${To.y.toFixed(4)}, ${To.z.toFixed(4)} );`,"	return dot( weights, rgb );","}"].join(`
`)}function ms(r){return r!==""}function pp(r,e){let t=e.numSpotLightShadows+e.numSpotLightMaps-e.numSpotLightShadowsWithMaps;return r.replace(/NUM_DIR_LIGHTS/g,e.numDirLights).replace(/NUM_SPOT_LIGHTS/g,e.numSpotLights).replace(/NUM_SPOT_LIGHT_MAPS/g,e.numSpotLightMaps).replace(/NUM_SPOT_LIGHT_COORDS/g,t).replace(/NUM_RECT_AREA_LIGHTS/g,e.numRectAreaLights).replace(/NUM_POINT_LIGHTS/g,e.numPointLights).replace(/NUM_HEMI_LIGHTS/g,e.numHemiLights).replace(/NUM_DIR_LIGHT_SHADOWS/g,e.numDirLightShadows).replace(/NUM_SPOT_LIGHT_SHADOWS_WITH_MAPS/g,e.numSpotLightShadowsWithMaps).replace(/NUM_SPOT_LIGHT_SHADOWS/g,e.numSpotLightShadows).replace(/NUM_POINT_LIGHT_SHADOWS/g,e.numPointLightShadows)}function fp(r,e){return r.replace(/NUM_CLIPPING_PLANES/g,e.numClippingPlanes).replace(/UNION_CLIPPING_PLANES/g,e.numClippingPlanes-e.numClipIntersection)}var l0=/^[ \t]*#include +<([\w\d./]+)>/gm;function gh(r){return r.replace(l0,h0)}var c0=new Map;function h0(r,e){let t=Ne[e];if(t===void 0){let i=c0.get(e);if(i===void 0)throw new Error("Can not resolve #include <"+e+">");t=Ne[i],we('WebGLRenderer: Shader chunk "%s" has been deprecated. Use "%s" instead.',e,i)}return gh(t)}var u0=/#pragma unroll_loop_start\s+for\s*\(\s*int\s+i\s*=\s*(\d+)\s*;\s*i\s*<\s*(\d+)\s*;\s*i\s*\+\+\s*\)\s*{([\s\S]+?)}\s+#pragma unroll_loop_end/g;function mp(r){return r.replace(u0,d0)}function d0(r,e,t,i){let n="";for(let s=parseInt(e);s<parseInt(t);s++)n+=i.replace(/\[\s*i\s*\]/g,"[ "+s+" ]").replace(/UNROLLED_LOOP_INDEX/g,s);return n}function gp(r){let e=`precision ${r.precision} float;
	precision ${r.precision} int;
	precision ${r.precision} sampler2D;
	precision ${r.precision} samplerCube;
	precision ${r.precision} sampler3D;
	precision ${r.precision} sampler2DArray;
	precision ${r.precision} sampler2DShadow;
	precision ${r.precision} samplerCubeShadow;
	precision ${r.precision} sampler2DArrayShadow;
	precision ${r.precision} isampler2D;
	precision ${r.precision} isampler3D;
	precision ${r.precision} isamplerCube;
	precision ${r.precision} isampler2DArray;
	precision ${r.precision} usampler2D;
	precision ${r.precision} usampler3D;
	precision ${r.precision} usamplerCube;
	precision ${r.precision} usampler2DArray;
	`;return r.precision==="highp"?e+=`
#define HIGH_PRECISION`:r.precision==="mediump"?e+=`
#define MEDIUM_PRECISION`:r.precision==="lowp"&&(e+=`
#define LOW_PRECISION`),e}var p0={[ls]:"SHADOWMAP_TYPE_PCF",[ur]:"SHADOWMAP_TYPE_VSM"},f0={[fr]:"ENVMAP_TYPE_CUBE",[An]:"ENVMAP_TYPE_CUBE",[hs]:"ENVMAP_TYPE_CUBE_UV"},m0={[An]:"ENVMAP_MODE_REFRACTION"},g0={[Id]:"ENVMAP_BLENDING_MULTIPLY",[Pd]:"ENVMAP_BLENDING_MIX",[Ld]:"ENVMAP_BLENDING_ADD"};function v0(r,e,t,i){let n=r.getContext(),s=t.defines,a=t.vertexShader,o=t.fragmentShader,l=(function(H){return p0[H.shadowMapType]||"SHADOWMAP_TYPE_BASIC"})(t),c=(function(H){return H.envMap===!1?"ENVMAP_TYPE_CUBE":f0[H.envMapMode]||"ENVMAP_TYPE_CUBE"})(t),h=(function(H){return H.envMap===!1?"ENVMAP_MODE_REFLECTION":m0[H.envMapMode]||"ENVMAP_MODE_REFLECTION"})(t),u=(function(H){return H.envMap===!1?"ENVMAP_BLENDING_NONE":g0[H.combine]||"ENVMAP_BLENDING_NONE"})(t),f=(function(H){let O=H.envMapCubeUVHeight;if(O===null)return null;let j=Math.log2(O)-2,z=1/O;return{texelWidth:1/(3*Math.max(Math.pow(2,j),112)),texelHeight:z,maxMip:j}})(t),p=(function(H){return[H.extensionClipCullDistance?"#extension GL_ANGLE_clip_cull_distance : require":"",H.extensionMultiDraw?"#extension GL_ANGLE_multi_draw : require":""].filter(ms).join(`
`)})(t),g=(function(H){let O=[];for(let j in H){let z=H[j];z!==!1&&O.push("#define "+j+" "+z)}return O.join(`
`)})(s),d=n.createProgram(),_,m,v=t.glslVersion?"#version "+t.glslVersion+`
`:"";t.isRawShaderMaterial?(_=["#define SHADER_TYPE "+t.shaderType,"#define SHADER_NAME "+t.shaderName,g].filter(ms).join(`
`),_.length>0&&(_+=`
`),m=["#define SHADER_TYPE "+t.shaderType,"#define SHADER_NAME "+t.shaderName,g].filter(ms).join(`
`),m.length>0&&(m+=`
`)):(_=[gp(t),"#define SHADER_TYPE "+t.shaderType,"#define SHADER_NAME "+t.shaderName,g,t.extensionClipCullDistance?"#define USE_CLIP_DISTANCE":"",t.batching?"#define USE_BATCHING":"",t.batchingColor?"#define USE_BATCHING_COLOR":"",t.instancing?"#define USE_INSTANCING":"",t.instancingColor?"#define USE_INSTANCING_COLOR":"",t.instancingMorph?"#define USE_INSTANCING_MORPH":"",t.useFog&&t.fog?"#define USE_FOG":"",t.useFog&&t.fogExp2?"#define FOG_EXP2":"",t.map?"#define USE_MAP":"",t.envMap?"#define USE_ENVMAP":"",t.envMap?"#define "+h:"",t.lightMap?"#define USE_LIGHTMAP":"",t.aoMap?"#define USE_AOMAP":"",t.bumpMap?"#define USE_BUMPMAP":"",t.normalMap?"#define USE_NORMALMAP":"",t.normalMapObjectSpace?"#define USE_NORMALMAP_OBJECTSPACE":"",t.normalMapTangentSpace?"#define USE_NORMALMAP_TANGENTSPACE":"",t.displacementMap?"#define USE_DISPLACEMENTMAP":"",t.emissiveMap?"#define USE_EMISSIVEMAP":"",t.anisotropy?"#define USE_ANISOTROPY":"",t.anisotropyMap?"#define USE_ANISOTROPYMAP":"",t.clearcoatMap?"#define USE_CLEARCOATMAP":"",t.clearcoatRoughnessMap?"#define USE_CLEARCOAT_ROUGHNESSMAP":"",t.clearcoatNormalMap?"#define USE_CLEARCOAT_NORMALMAP":"",t.iridescenceMap?"#define USE_IRIDESCENCEMAP":"",t.iridescenceThicknessMap?"#define USE_IRIDESCENCE_THICKNESSMAP":"",t.specularMap?"#define USE_SPECULARMAP":"",t.specularColorMap?"#define USE_SPECULAR_COLORMAP":"",t.specularIntensityMap?"#define USE_SPECULAR_INTENSITYMAP":"",t.roughnessMap?"#define USE_ROUGHNESSMAP":"",t.metalnessMap?"#define USE_METALNESSMAP":"",t.alphaMap?"#define USE_ALPHAMAP":"",t.alphaHash?"#define USE_ALPHAHASH":"",t.transmission?"#define USE_TRANSMISSION":"",t.transmissionMap?"#define USE_TRANSMISSIONMAP":"",t.thicknessMap?"#define USE_THICKNESSMAP":"",t.sheenColorMap?"#define USE_SHEEN_COLORMAP":"",t.sheenRoughnessMap?"#define USE_SHEEN_ROUGHNESSMAP":"",t.mapUv?"#define MAP_UV "+t.mapUv:"",t.alphaMapUv?"#define ALPHAMAP_UV "+t.alphaMapUv:"",t.lightMapUv?"#define LIGHTMAP_UV "+t.lightMapUv:"",t.aoMapUv?"#define AOMAP_UV "+t.aoMapUv:"",t.emissiveMapUv?"#define EMISSIVEMAP_UV "+t.emissiveMapUv:"",t.bumpMapUv?"#define BUMPMAP_UV "+t.bumpMapUv:"",t.normalMapUv?"#define NORMALMAP_UV "+t.normalMapUv:"",t.displacementMapUv?"#define DISPLACEMENTMAP_UV "+t.displacementMapUv:"",t.metalnessMapUv?"#define METALNESSMAP_UV "+t.metalnessMapUv:"",t.roughnessMapUv?"#define ROUGHNESSMAP_UV "+t.roughnessMapUv:"",t.anisotropyMapUv?"#define ANISOTROPYMAP_UV "+t.anisotropyMapUv:"",t.clearcoatMapUv?"#define CLEARCOATMAP_UV "+t.clearcoatMapUv:"",t.clearcoatNormalMapUv?"#define CLEARCOAT_NORMALMAP_UV "+t.clearcoatNormalMapUv:"",t.clearcoatRoughnessMapUv?"#define CLEARCOAT_ROUGHNESSMAP_UV "+t.clearcoatRoughnessMapUv:"",t.iridescenceMapUv?"#define IRIDESCENCEMAP_UV "+t.iridescenceMapUv:"",t.iridescenceThicknessMapUv?"#define IRIDESCENCE_THICKNESSMAP_UV "+t.iridescenceThicknessMapUv:"",t.sheenColorMapUv?"#define SHEEN_COLORMAP_UV "+t.sheenColorMapUv:"",t.sheenRoughnessMapUv?"#define SHEEN_ROUGHNESSMAP_UV "+t.sheenRoughnessMapUv:"",t.specularMapUv?"#define SPECULARMAP_UV "+t.specularMapUv:"",t.specularColorMapUv?"#define SPECULAR_COLORMAP_UV "+t.specularColorMapUv:"",t.specularIntensityMapUv?"#define SPECULAR_INTENSITYMAP_UV "+t.specularIntensityMapUv:"",t.transmissionMapUv?"#define TRANSMISSIONMAP_UV "+t.transmissionMapUv:"",t.thicknessMapUv?"#define THICKNESSMAP_UV "+t.thicknessMapUv:"",t.vertexTangents&&t.flatShading===!1?"#define USE_TANGENT":"",t.vertexNormals?"#define HAS_NORMAL":"",t.vertexColors?"#define USE_COLOR":"",t.vertexAlphas?"#define USE_COLOR_ALPHA":"",t.vertexUv1s?"#define USE_UV1":"",t.vertexUv2s?"#define USE_UV2":"",t.vertexUv3s?"#define USE_UV3":"",t.pointsUvs?"#define USE_POINTS_UV":"",t.flatShading?"#define FLAT_SHADED":"",t.skinning?"#define USE_SKINNING":"",t.morphTargets?"#define USE_MORPHTARGETS":"",t.morphNormals&&t.flatShading===!1?"#define USE_MORPHNORMALS":"",t.morphColors?"#define USE_MORPHCOLORS":"",t.morphTargetsCount>0?"#define MORPHTARGETS_TEXTURE_STRIDE "+t.morphTextureStride:"",t.morphTargetsCount>0?"#define MORPHTARGETS_COUNT "+t.morphTargetsCount:"",t.doubleSided?"#define DOUBLE_SIDED":"",t.flipSided?"#define FLIP_SIDED":"",t.shadowMapEnabled?"#define USE_SHADOWMAP":"",t.shadowMapEnabled?"#define "+l:"",t.sizeAttenuation?"#define USE_SIZEATTENUATION":"",t.numLightProbes>0?"#define USE_LIGHT_PROBES":"",t.logarithmicDepthBuffer?"#define USE_LOGARITHMIC_DEPTH_BUFFER":"",t.reversedDepthBuffer?"#define USE_REVERSED_DEPTH_BUFFER":"","uniform mat4 modelMatrix;","uniform mat4 modelViewMatrix;","uniform mat4 projectionMatrix;","uniform mat4 viewMatrix;","uniform mat3 normalMatrix;","uniform vec3 cameraPosition;","uniform bool isOrthographic;","#ifdef USE_INSTANCING","	attribute mat4 instanceMatrix;","#endif","#ifdef USE_INSTANCING_COLOR","	attribute vec3 instanceColor;","#endif","#ifdef USE_INSTANCING_MORPH","	uniform sampler2D morphTexture;","#endif","attribute vec3 position;","attribute vec3 normal;","attribute vec2 uv;","#ifdef USE_UV1","	attribute vec2 uv1;","#endif","#ifdef USE_UV2","	attribute vec2 uv2;","#endif","#ifdef USE_UV3","	attribute vec2 uv3;","#endif","#ifdef USE_TANGENT","	attribute vec4 tangent;","#endif","#if defined( USE_COLOR_ALPHA )","	attribute vec4 color;","#elif defined( USE_COLOR )","	attribute vec3 color;","#endif","#ifdef USE_SKINNING","	attribute vec4 skinIndex;","	attribute vec4 skinWeight;","#endif",`
`].filter(ms).join(`
`),m=[gp(t),"#define SHADER_TYPE "+t.shaderType,"#define SHADER_NAME "+t.shaderName,g,t.useFog&&t.fog?"#define USE_FOG":"",t.useFog&&t.fogExp2?"#define FOG_EXP2":"",t.alphaToCoverage?"#define ALPHA_TO_COVERAGE":"",t.map?"#define USE_MAP":"",t.matcap?"#define USE_MATCAP":"",t.envMap?"#define USE_ENVMAP":"",t.envMap?"#define "+c:"",t.envMap?"#define "+h:"",t.envMap?"#define "+u:"",f?"#define CUBEUV_TEXEL_WIDTH "+f.texelWidth:"",f?"#define CUBEUV_TEXEL_HEIGHT "+f.texelHeight:"",f?"#define CUBEUV_MAX_MIP "+f.maxMip+".0":"",t.lightMap?"#define USE_LIGHTMAP":"",t.aoMap?"#define USE_AOMAP":"",t.bumpMap?"#define USE_BUMPMAP":"",t.normalMap?"#define USE_NORMALMAP":"",t.normalMapObjectSpace?"#define USE_NORMALMAP_OBJECTSPACE":"",t.normalMapTangentSpace?"#define USE_NORMALMAP_TANGENTSPACE":"",t.packedNormalMap?"#define USE_PACKED_NORMALMAP":"",t.emissiveMap?"#define USE_EMISSIVEMAP":"",t.anisotropy?"#define USE_ANISOTROPY":"",t.anisotropyMap?"#define USE_ANISOTROPYMAP":"",t.clearcoat?"#define USE_CLEARCOAT":"",t.clearcoatMap?"#define USE_CLEARCOATMAP":"",t.clearcoatRoughnessMap?"#define USE_CLEARCOAT_ROUGHNESSMAP":"",t.clearcoatNormalMap?"#define USE_CLEARCOAT_NORMALMAP":"",t.dispersion?"#define USE_DISPERSION":"",t.iridescence?"#define USE_IRIDESCENCE":"",t.iridescenceMap?"#define USE_IRIDESCENCEMAP":"",t.iridescenceThicknessMap?"#define USE_IRIDESCENCE_THICKNESSMAP":"",t.specularMap?"#define USE_SPECULARMAP":"",t.specularColorMap?"#define USE_SPECULAR_COLORMAP":"",t.specularIntensityMap?"#define USE_SPECULAR_INTENSITYMAP":"",t.roughnessMap?"#define USE_ROUGHNESSMAP":"",t.metalnessMap?"#define USE_METALNESSMAP":"",t.alphaMap?"#define USE_ALPHAMAP":"",t.alphaTest?"#define USE_ALPHATEST":"",t.alphaHash?"#define USE_ALPHAHASH":"",t.sheen?"#define USE_SHEEN":"",t.sheenColorMap?"#define USE_SHEEN_COLORMAP":"",t.sheenRoughnessMap?"#define USE_SHEEN_ROUGHNESSMAP":"",t.transmission?"#define USE_TRANSMISSION":"",t.transmissionMap?"#define USE_TRANSMISSIONMAP":"",t.thicknessMap?"#define USE_THICKNESSMAP":"",t.vertexTangents&&t.flatShading===!1?"#define USE_TANGENT":"",t.vertexColors||t.instancingColor?"#define USE_COLOR":"",t.vertexAlphas||t.batchingColor?"#define USE_COLOR_ALPHA":"",t.vertexUv1s?"#define USE_UV1":"",t.vertexUv2s?"#define USE_UV2":"",t.vertexUv3s?"#define USE_UV3":"",t.pointsUvs?"#define USE_POINTS_UV":"",t.gradientMap?"#define USE_GRADIENTMAP":"",t.flatShading?"#define FLAT_SHADED":"",t.doubleSided?"#define DOUBLE_SIDED":"",t.flipSided?"#define FLIP_SIDED":"",t.shadowMapEnabled?"#define USE_SHADOWMAP":"",t.shadowMapEnabled?"#define "+l:"",t.premultipliedAlpha?"#define PREMULTIPLIED_ALPHA":"",t.numLightProbes>0?"#define USE_LIGHT_PROBES":"",t.numLightProbeGrids>0?"#define USE_LIGHT_PROBES_GRID":"",t.decodeVideoTexture?"#define DECODE_VIDEO_TEXTURE":"",t.decodeVideoTextureEmissive?"#define DECODE_VIDEO_TEXTURE_EMISSIVE":"",t.logarithmicDepthBuffer?"#define USE_LOGARITHMIC_DEPTH_BUFFER":"",t.reversedDepthBuffer?"#define USE_REVERSED_DEPTH_BUFFER":"","uniform mat4 viewMatrix;","uniform vec3 cameraPosition;","uniform bool isOrthographic;",t.toneMapping!==mi?"#define TONE_MAPPING":"",t.toneMapping!==mi?Ne.tonemapping_pars_fragment:"",t.toneMapping!==mi?a0("toneMapping",t.toneMapping):"",t.dithering?"#define DITHERING":"",t.opaque?"#define OPAQUE":"",Ne.colorspace_pars_fragment,r0("linearToOutputTexel",t.outputColorSpace),o0(),t.useDepthPacking?"#define DEPTH_PACKING "+t.depthPacking:"",`
`].filter(ms).join(`
`)),a=gh(a),a=pp(a,t),a=fp(a,t),o=gh(o),o=pp(o,t),o=fp(o,t),a=mp(a),o=mp(o),t.isRawShaderMaterial!==!0&&(v=`#version 300 es
`,_=[p,"#define attribute in","#define varying out","#define texture2D texture"].join(`
`)+`
`+_,m=["#define varying in",t.glslVersion===ds?"":"layout(location = 0) out highp vec4 pc_fragColor;",t.glslVersion===ds?"":"#define gl_FragColor pc_fragColor","#define gl_FragDepthEXT gl_FragDepth","#define texture2D texture","#define textureCube texture","#define texture2DProj textureProj","#define texture2DLodEXT textureLod","#define texture2DProjLodEXT textureProjLod","#define textureCubeLodEXT textureLod","#define texture2DGradEXT textureGrad","#define texture2DProjGradEXT textureProjGrad","#define textureCubeGradEXT textureGrad"].join(`
`)+`
`+m);let y=v+_+a,w=v+m+o,E=hp(n,n.VERTEX_SHADER,y),M=hp(n,n.FRAGMENT_SHADER,w);function D(H){if(r.debug.checkShaderErrors){let O=n.getProgramInfoLog(d)||"",j=n.getShaderInfoLog(E)||"",z=n.getShaderInfoLog(M)||"",k=O.trim(),q=j.trim(),X=z.trim(),oe=!0,ue=!0;if(n.getProgramParameter(d,n.LINK_STATUS)===!1)if(oe=!1,typeof r.debug.onShaderError=="function")r.debug.onShaderError(n,d,E,M);else{let be=dp(n,E,"vertex"),ye=dp(n,M,"fragment");Te("THREE.WebGLProgram: Shader Error "+n.getError()+" - VALIDATE_STATUS "+n.getProgramParameter(d,n.VALIDATE_STATUS)+`

Material Name: `+H.name+`
Material Type: `+H.type+`

Program Info Log: `+k+`
`+be+`
`+ye)}else k!==""?we("WebGLProgram: Program Info Log:",k):q!==""&&X!==""||(ue=!1);ue&&(H.diagnostics={runnable:oe,programLog:k,vertexShader:{log:q,prefix:_},fragmentShader:{log:X,prefix:m}})}n.deleteShader(E),n.deleteShader(M),F=new _r(n,d),I=(function(O,j){let z={},k=O.getProgramParameter(j,O.ACTIVE_ATTRIBUTES);for(let q=0;q<k;q++){let X=O.getActiveAttrib(j,q),oe=X.name,ue=1;X.type===O.FLOAT_MAT2&&(ue=2),X.type===O.FLOAT_MAT3&&(ue=3),X.type===O.FLOAT_MAT4&&(ue=4),z[oe]={type:X.type,location:O.getAttribLocation(j,oe),locationSize:ue}}return z})(n,d)}let F,I;n.attachShader(d,E),n.attachShader(d,M),t.index0AttributeName!==void 0?n.bindAttribLocation(d,0,t.index0AttributeName):t.morphTargets===!0&&n.bindAttribLocation(d,0,"position"),n.linkProgram(d),this.getUniforms=function(){return F===void 0&&D(this),F},this.getAttributes=function(){return I===void 0&&D(this),I};let P=t.rendererExtensionParallelShaderCompile===!1;return this.isReady=function(){return P===!1&&(P=n.getProgramParameter(d,37297)),P},this.destroy=function(){i.releaseStatesOfProgram(this),n.deleteProgram(d),this.program=void 0},this.type=t.shaderType,this.name=t.shaderName,this.id=n0++,this.cacheKey=e,this.usedTimes=1,this.program=d,this.vertexShader=E,this.fragmentShader=M,this}var _0=0,vh=class{constructor(){this.shaderCache=new Map,this.materialCache=new Map}update(e){let t=e.vertexShader,i=e.fragmentShader,n=this._getShaderStage(t),s=this._getShaderStage(i),a=this._getShaderCacheForMaterial(e);return a.has(n)===!1&&(a.add(n),n.usedTimes++),a.has(s)===!1&&(a.add(s),s.usedTimes++),this}remove(e){let t=this.materialCache.get(e);for(let i of t)i.usedTimes--,i.usedTimes===0&&this.shaderCache.delete(i.code);return this.materialCache.delete(e),this}getVertexShaderID(e){return this._getShaderStage(e.vertexShader).id}getFragmentShaderID(e){return this._getShaderStage(e.fragmentShader).id}dispose(){this.shaderCache.clear(),this.materialCache.clear()}_getShaderCacheForMaterial(e){let t=this.materialCache,i=t.get(e);return i===void 0&&(i=new Set,t.set(e,i)),i}_getShaderStage(e){let t=this.shaderCache,i=t.get(e);return i===void 0&&(i=new _h(e),t.set(e,i)),i}},_h=class{constructor(e){this.id=_0++,this.code=e,this.usedTimes=0}};function x0(r,e,t,i,n,s){let a=new Hr,o=new vh,l=new Set,c=[],h=new Map,u=i.logarithmicDepthBuffer,f=i.precision,p={MeshDepthMaterial:"depth",MeshDistanceMaterial:"distance",MeshNormalMaterial:"normal",MeshBasicMaterial:"basic",MeshLambertMaterial:"lambert",MeshPhongMaterial:"phong",MeshToonMaterial:"toon",MeshStandardMaterial:"physical",MeshPhysicalMaterial:"physical",MeshMatcapMaterial:"matcap",LineBasicMaterial:"basic",LineDashedMaterial:"dashed",PointsMaterial:"points",ShadowMaterial:"shadow",SpriteMaterial:"sprite"};function g(d){return l.add(d),d===0?"uv":`uv${d}`}return{getParameters:function(d,_,m,v,y,w){let E=v.fog,M=y.geometry,D=d.isMeshStandardMaterial||d.isMeshLambertMaterial||d.isMeshPhongMaterial?v.environment:null,F=d.isMeshStandardMaterial||d.isMeshLambertMaterial&&!d.envMap||d.isMeshPhongMaterial&&!d.envMap,I=e.get(d.envMap||D,F),P=I&&I.mapping===hs?I.image.height:null,H=p[d.type];d.precision!==null&&(f=i.getMaxPrecision(d.precision),f!==d.precision&&we("WebGLProgram.getParameters:",d.precision,"not supported, using",f,"instead."));let O=M.morphAttributes.position||M.morphAttributes.normal||M.morphAttributes.color,j=O!==void 0?O.length:0,z,k,q,X,oe=0;if(M.morphAttributes.position!==void 0&&(oe=1),M.morphAttributes.normal!==void 0&&(oe=2),M.morphAttributes.color!==void 0&&(oe=3),H){let Gt=Pi[H];z=Gt.vertexShader,k=Gt.fragmentShader}else z=d.vertexShader,k=d.fragmentShader,o.update(d),q=o.getVertexShaderID(d),X=o.getFragmentShaderID(d);let ue=r.getRenderTarget(),be=r.state.buffers.depth.getReversed(),ye=y.isInstancedMesh===!0,xe=y.isBatchedMesh===!0,ee=!!d.map,ae=!!d.matcap,ie=!!I,ve=!!d.aoMap,ke=!!d.lightMap,te=!!d.bumpMap,R=!!d.normalMap,S=!!d.displacementMap,C=!!d.emissiveMap,N=!!d.metalnessMap,x=!!d.roughnessMap,L=d.anisotropy>0,U=d.clearcoat>0,T=d.dispersion>0,V=d.iridescence>0,W=d.sheen>0,$=d.transmission>0,Q=L&&!!d.anisotropyMap,de=U&&!!d.clearcoatMap,Z=U&&!!d.clearcoatNormalMap,fe=U&&!!d.clearcoatRoughnessMap,ce=V&&!!d.iridescenceMap,pe=V&&!!d.iridescenceThicknessMap,se=W&&!!d.sheenColorMap,Me=W&&!!d.sheenRoughnessMap,ze=!!d.specularMap,nt=!!d.specularColorMap,qe=!!d.specularIntensityMap,rt=$&&!!d.transmissionMap,Ft=$&&!!d.thicknessMap,Se=!!d.gradientMap,Oe=!!d.alphaMap,Ce=d.alphaTest>0,tt=!!d.alphaHash,Pt=!!d.extensions,vi=mi;d.toneMapped&&(ue!==null&&ue.isXRRenderTarget!==!0||(vi=r.toneMapping));let Qt={shaderID:H,shaderType:d.type,shaderName:d.name,vertexShader:z,fragmentShader:k,defines:d.defines,customVertexShaderID:q,customFragmentShaderID:X,isRawShaderMaterial:d.isRawShaderMaterial===!0,glslVersion:d.glslVersion,precision:f,batching:xe,batchingColor:xe&&y._colorsTexture!==null,instancing:ye,instancingColor:ye&&y.instanceColor!==null,instancingMorph:ye&&y.morphTexture!==null,outputColorSpace:ue===null?r.outputColorSpace:ue.isXRRenderTarget===!0?ue.texture.colorSpace:Ve.workingColorSpace,alphaToCoverage:!!d.alphaToCoverage,map:ee,matcap:ae,envMap:ie,envMapMode:ie&&I.mapping,envMapCubeUVHeight:P,aoMap:ve,lightMap:ke,bumpMap:te,normalMap:R,displacementMap:S,emissiveMap:C,normalMapObjectSpace:R&&d.normalMapType===Fd,normalMapTangentSpace:R&&d.normalMapType===eh,packedNormalMap:R&&d.normalMapType===eh&&(_t=d.normalMap.format,_t===Pn||_t===yo||_t===Mo),metalnessMap:N,roughnessMap:x,anisotropy:L,anisotropyMap:Q,clearcoat:U,clearcoatMap:de,clearcoatNormalMap:Z,clearcoatRoughnessMap:fe,dispersion:T,iridescence:V,iridescenceMap:ce,iridescenceThicknessMap:pe,sheen:W,sheenColorMap:se,sheenRoughnessMap:Me,specularMap:ze,specularColorMap:nt,specularIntensityMap:qe,transmission:$,transmissionMap:rt,thicknessMap:Ft,gradientMap:Se,opaque:d.transparent===!1&&d.blending===cs&&d.alphaToCoverage===!1,alphaMap:Oe,alphaTest:Ce,alphaHash:tt,combine:d.combine,mapUv:ee&&g(d.map.channel),aoMapUv:ve&&g(d.aoMap.channel),lightMapUv:ke&&g(d.lightMap.channel),bumpMapUv:te&&g(d.bumpMap.channel),normalMapUv:R&&g(d.normalMap.channel),displacementMapUv:S&&g(d.displacementMap.channel),emissiveMapUv:C&&g(d.emissiveMap.channel),metalnessMapUv:N&&g(d.metalnessMap.channel),roughnessMapUv:x&&g(d.roughnessMap.channel),anisotropyMapUv:Q&&g(d.anisotropyMap.channel),clearcoatMapUv:de&&g(d.clearcoatMap.channel),clearcoatNormalMapUv:Z&&g(d.clearcoatNormalMap.channel),clearcoatRoughnessMapUv:fe&&g(d.clearcoatRoughnessMap.channel),iridescenceMapUv:ce&&g(d.iridescenceMap.channel),iridescenceThicknessMapUv:pe&&g(d.iridescenceThicknessMap.channel),sheenColorMapUv:se&&g(d.sheenColorMap.channel),sheenRoughnessMapUv:Me&&g(d.sheenRoughnessMap.channel),specularMapUv:ze&&g(d.specularMap.channel),specularColorMapUv:nt&&g(d.specularColorMap.channel),specularIntensityMapUv:qe&&g(d.specularIntensityMap.channel),transmissionMapUv:rt&&g(d.transmissionMap.channel),thicknessMapUv:Ft&&g(d.thicknessMap.channel),alphaMapUv:Oe&&g(d.alphaMap.channel),vertexTangents:!!M.attributes.tangent&&(R||L),vertexNormals:!!M.attributes.normal,vertexColors:d.vertexColors,vertexAlphas:d.vertexColors===!0&&!!M.attributes.color&&M.attributes.color.itemSize===4,pointsUvs:y.isPoints===!0&&!!M.attributes.uv&&(ee||Oe),fog:!!E,useFog:d.fog===!0,fogExp2:!!E&&E.isFogExp2,flatShading:d.wireframe===!1&&(d.flatShading===!0||M.attributes.normal===void 0&&R===!1&&(d.isMeshLambertMaterial||d.isMeshPhongMaterial||d.isMeshStandardMaterial||d.isMeshPhysicalMaterial)),sizeAttenuation:d.sizeAttenuation===!0,logarithmicDepthBuffer:u,reversedDepthBuffer:be,skinning:y.isSkinnedMesh===!0,morphTargets:M.morphAttributes.position!==void 0,morphNormals:M.morphAttributes.normal!==void 0,morphColors:M.morphAttributes.color!==void 0,morphTargetsCount:j,morphTextureStride:oe,numDirLights:_.directional.length,numPointLights:_.point.length,numSpotLights:_.spot.length,numSpotLightMaps:_.spotLightMap.length,numRectAreaLights:_.rectArea.length,numHemiLights:_.hemi.length,numDirLightShadows:_.directionalShadowMap.length,numPointLightShadows:_.pointShadowMap.length,numSpotLightShadows:_.spotShadowMap.length,numSpotLightShadowsWithMaps:_.numSpotLightShadowsWithMaps,numLightProbes:_.numLightProbes,numLightProbeGrids:w.length,numClippingPlanes:s.numPlanes,numClipIntersection:s.numIntersection,dithering:d.dithering,shadowMapEnabled:r.shadowMap.enabled&&m.length>0,shadowMapType:r.shadowMap.type,toneMapping:vi,decodeVideoTexture:ee&&d.map.isVideoTexture===!0&&Ve.getTransfer(d.map.colorSpace)===Ke,decodeVideoTextureEmissive:C&&d.emissiveMap.isVideoTexture===!0&&Ve.getTransfer(d.emissiveMap.colorSpace)===Ke,premultipliedAlpha:d.premultipliedAlpha,doubleSided:d.side===Ai,flipSided:d.side===Wt,useDepthPacking:d.depthPacking>=0,depthPacking:d.depthPacking||0,index0AttributeName:d.index0AttributeName,extensionClipCullDistance:Pt&&d.extensions.clipCullDistance===!0&&t.has("WEBGL_clip_cull_distance"),extensionMultiDraw:(Pt&&d.extensions.multiDraw===!0||xe)&&t.has("WEBGL_multi_draw"),rendererExtensionParallelShaderCompile:t.has("KHR_parallel_shader_compile"),customProgramCacheKey:d.customProgramCacheKey()};var _t;return Qt.vertexUv1s=l.has(1),Qt.vertexUv2s=l.has(2),Qt.vertexUv3s=l.has(3),l.clear(),Qt},getProgramCacheKey:function(d){let _=[];if(d.shaderID?_.push(d.shaderID):(_.push(d.customVertexShaderID),_.push(d.customFragmentShaderID)),d.defines!==void 0)for(let m in d.defines)_.push(m),_.push(d.defines[m]);return d.isRawShaderMaterial===!1&&((function(m,v){m.push(v.precision),m.push(v.outputColorSpace),m.push(v.envMapMode),m.push(v.envMapCubeUVHeight),m.push(v.mapUv),m.push(v.alphaMapUv),m.push(v.lightMapUv),m.push(v.aoMapUv),m.push(v.bumpMapUv),m.push(v.normalMapUv),m.push(v.displacementMapUv),m.push(v.emissiveMapUv),m.push(v.metalnessMapUv),m.push(v.roughnessMapUv),m.push(v.anisotropyMapUv),m.push(v.clearcoatMapUv),m.push(v.clearcoatNormalMapUv),m.push(v.clearcoatRoughnessMapUv),m.push(v.iridescenceMapUv),m.push(v.iridescenceThicknessMapUv),m.push(v.sheenColorMapUv),m.push(v.sheenRoughnessMapUv),m.push(v.specularMapUv),m.push(v.specularColorMapUv),m.push(v.specularIntensityMapUv),m.push(v.transmissionMapUv),m.push(v.thicknessMapUv),m.push(v.combine),m.push(v.fogExp2),m.push(v.sizeAttenuation),m.push(v.morphTargetsCount),m.push(v.morphAttributeCount),m.push(v.numDirLights),m.push(v.numPointLights),m.push(v.numSpotLights),m.push(v.numSpotLightMaps),m.push(v.numHemiLights),m.push(v.numRectAreaLights),m.push(v.numDirLightShadows),m.push(v.numPointLightShadows),m.push(v.numSpotLightShadows),m.push(v.numSpotLightShadowsWithMaps),m.push(v.numLightProbes),m.push(v.shadowMapType),m.push(v.toneMapping),m.push(v.numClippingPlanes),m.push(v.numClipIntersection),m.push(v.depthPacking)})(_,d),(function(m,v){a.disableAll(),v.instancing&&a.enable(0),v.instancingColor&&a.enable(1),v.instancingMorph&&a.enable(2),v.matcap&&a.enable(3),v.envMap&&a.enable(4),v.normalMapObjectSpace&&a.enable(5),v.normalMapTangentSpace&&a.enable(6),v.clearcoat&&a.enable(7),v.iridescence&&a.enable(8),v.alphaTest&&a.enable(9),v.vertexColors&&a.enable(10),v.vertexAlphas&&a.enable(11),v.vertexUv1s&&a.enable(12),v.vertexUv2s&&a.enable(13),v.vertexUv3s&&a.enable(14),v.vertexTangents&&a.enable(15),v.anisotropy&&a.enable(16),v.alphaHash&&a.enable(17),v.batching&&a.enable(18),v.dispersion&&a.enable(19),v.batchingColor&&a.enable(20),v.gradientMap&&a.enable(21),v.packedNormalMap&&a.enable(22),v.vertexNormals&&a.enable(23),m.push(a.mask),a.disableAll(),v.fog&&a.enable(0),v.useFog&&a.enable(1),v.flatShading&&a.enable(2),v.logarithmicDepthBuffer&&a.enable(3),v.reversedDepthBuffer&&a.enable(4),v.skinning&&a.enable(5),v.morphTargets&&a.enable(6),v.morphNormals&&a.enable(7),v.morphColors&&a.enable(8),v.premultipliedAlpha&&a.enable(9),v.shadowMapEnabled&&a.enable(10),v.doubleSided&&a.enable(11),v.flipSided&&a.enable(12),v.useDepthPacking&&a.enable(13),v.dithering&&a.enable(14),v.transmission&&a.enable(15),v.sheen&&a.enable(16),v.opaque&&a.enable(17),v.pointsUvs&&a.enable(18),v.decodeVideoTexture&&a.enable(19),v.decodeVideoTextureEmissive&&a.enable(20),v.alphaToCoverage&&a.enable(21),v.numLightProbeGrids>0&&a.enable(22),m.push(a.mask)})(_,d),_.push(r.outputColorSpace)),_.push(d.customProgramCacheKey),_.join()},getUniforms:function(d){let _=p[d.type],m;if(_){let v=Pi[_];m=$d.clone(v.uniforms)}else m=d.uniforms;return m},acquireProgram:function(d,_){let m=h.get(_);return m!==void 0?++m.usedTimes:(m=new v0(r,_,d,n),c.push(m),h.set(_,m)),m},releaseProgram:function(d){if(--d.usedTimes===0){let _=c.indexOf(d);c[_]=c[c.length-1],c.pop(),h.delete(d.cacheKey),d.destroy()}},releaseShaderCache:function(d){o.remove(d)},programs:c,dispose:function(){o.dispose()}}}function y0(){let r=new WeakMap;return{has:function(e){return r.has(e)},get:function(e){let t=r.get(e);return t===void 0&&(t={},r.set(e,t)),t},remove:function(e){r.delete(e)},update:function(e,t,i){r.get(e)[t]=i},dispose:function(){r=new WeakMap}}}function M0(r,e){return r.groupOrder!==e.groupOrder?r.groupOrder-e.groupOrder:r.renderOrder!==e.renderOrder?r.renderOrder-e.renderOrder:r.material.id!==e.material.id?r.material.id-e.material.id:r.materialVariant!==e.materialVariant?r.materialVariant-e.materialVariant:r.z!==e.z?r.z-e.z:r.id-e.id}function vp(r,e){return r.groupOrder!==e.groupOrder?r.groupOrder-e.groupOrder:r.renderOrder!==e.renderOrder?r.renderOrder-e.renderOrder:r.z!==e.z?e.z-r.z:r.id-e.id}function _p(){let r=[],e=0,t=[],i=[],n=[];function s(o){let l=0;return o.isInstancedMesh&&(l+=2),o.isSkinnedMesh&&(l+=1),l}function a(o,l,c,h,u,f){let p=r[e];return p===void 0?(p={id:o.id,object:o,geometry:l,material:c,materialVariant:s(o),groupOrder:h,renderOrder:o.renderOrder,z:u,group:f},r[e]=p):(p.id=o.id,p.object=o,p.geometry=l,p.material=c,p.materialVariant=s(o),p.groupOrder=h,p.renderOrder=o.renderOrder,p.z=u,p.group=f),e++,p}return{opaque:t,transmissive:i,transparent:n,init:function(){e=0,t.length=0,i.length=0,n.length=0},push:function(o,l,c,h,u,f){let p=a(o,l,c,h,u,f);c.transmission>0?i.push(p):c.transparent===!0?n.push(p):t.push(p)},unshift:function(o,l,c,h,u,f){let p=a(o,l,c,h,u,f);c.transmission>0?i.unshift(p):c.transparent===!0?n.unshift(p):t.unshift(p)},finish:function(){for(let o=e,l=r.length;o<l;o++){let c=r[o];if(c.id===null)break;c.id=null,c.object=null,c.geometry=null,c.material=null,c.group=null}},sort:function(o,l){t.length>1&&t.sort(o||M0),i.length>1&&i.sort(l||vp),n.length>1&&n.sort(l||vp)}}}function S0(){let r=new WeakMap;return{get:function(e,t){let i=r.get(e),n;return i===void 0?(n=new _p,r.set(e,[n])):t>=i.length?(n=new _p,i.push(n)):n=i[t],n},dispose:function(){r=new WeakMap}}}function b0(){let r={};return{get:function(e){if(r[e.id]!==void 0)return r[e.id];let t;switch(e.type){case"DirectionalLight":t={direction:new A,color:new je};break;case"SpotLight":t={position:new A,direction:new A,color:new je,distance:0,coneCos:0,penumbraCos:0,decay:0};break;case"PointLight":t={position:new A,color:new je,distance:0,decay:0};break;case"HemisphereLight":t={direction:new A,skyColor:new je,groundColor:new je};break;case"RectAreaLight":t={color:new je,position:new A,halfWidth:new A,halfHeight:new A}}return r[e.id]=t,t}}}var w0=0;function T0(r,e){return(e.castShadow?2:0)-(r.castShadow?2:0)+(e.map?1:0)-(r.map?1:0)}function E0(r){let e=new b0,t=(function(){let o={};return{get:function(l){if(o[l.id]!==void 0)return o[l.id];let c;switch(l.type){case"DirectionalLight":case"SpotLight":c={shadowIntensity:1,shadowBias:0,shadowNormalBias:0,shadowRadius:1,shadowMapSize:new ne};break;case"PointLight":c={shadowIntensity:1,shadowBias:0,shadowNormalBias:0,shadowRadius:1,shadowMapSize:new ne,shadowCameraNear:1,shadowCameraFar:1e3}}return o[l.id]=c,c}}})(),i={version:0,hash:{directionalLength:-1,pointLength:-1,spotLength:-1,rectAreaLength:-1,hemiLength:-1,numDirectionalShadows:-1,numPointShadows:-1,numSpotShadows:-1,numSpotMaps:-1,numLightProbes:-1},ambient:[0,0,0],probe:[],directional:[],directionalShadow:[],directionalShadowMap:[],directionalShadowMatrix:[],spot:[],spotLightMap:[],spotShadow:[],spotShadowMap:[],spotLightMatrix:[],rectArea:[],rectAreaLTC1:null,rectAreaLTC2:null,point:[],pointShadow:[],pointShadowMap:[],pointShadowMatrix:[],hemi:[],numSpotLightShadowsWithMaps:0,numLightProbes:0};for(let o=0;o<9;o++)i.probe.push(new A);let n=new A,s=new De,a=new De;return{setup:function(o){let l=0,c=0,h=0;for(let D=0;D<9;D++)i.probe[D].set(0,0,0);let u=0,f=0,p=0,g=0,d=0,_=0,m=0,v=0,y=0,w=0,E=0;o.sort(T0);for(let D=0,F=o.length;D<F;D++){let I=o[D],P=I.color,H=I.intensity,O=I.distance,j=null;if(I.shadow&&I.shadow.map&&(j=I.shadow.map.texture.format===Pn?I.shadow.map.texture:I.shadow.map.depthTexture||I.shadow.map.texture),I.isAmbientLight)l+=P.r*H,c+=P.g*H,h+=P.b*H;else if(I.isLightProbe){for(let z=0;z<9;z++)i.probe[z].addScaledVector(I.sh.coefficients[z],H);E++}else if(I.isDirectionalLight){let z=e.get(I);if(z.color.copy(I.color).multiplyScalar(I.intensity),I.castShadow){let k=I.shadow,q=t.get(I);q.shadowIntensity=k.intensity,q.shadowBias=k.bias,q.shadowNormalBias=k.normalBias,q.shadowRadius=k.radius,q.shadowMapSize=k.mapSize,i.directionalShadow[u]=q,i.directionalShadowMap[u]=j,i.directionalShadowMatrix[u]=I.shadow.matrix,_++}i.directional[u]=z,u++}else if(I.isSpotLight){let z=e.get(I);z.position.setFromMatrixPosition(I.matrixWorld),z.color.copy(P).multiplyScalar(H),z.distance=O,z.coneCos=Math.cos(I.angle),z.penumbraCos=Math.cos(I.angle*(1-I.penumbra)),z.decay=I.decay,i.spot[p]=z;let k=I.shadow;if(I.map&&(i.spotLightMap[y]=I.map,y++,k.updateMatrices(I),I.castShadow&&w++),i.spotLightMatrix[p]=k.matrix,I.castShadow){let q=t.get(I);q.shadowIntensity=k.intensity,q.shadowBias=k.bias,q.shadowNormalBias=k.normalBias,q.shadowRadius=k.radius,q.shadowMapSize=k.mapSize,i.spotShadow[p]=q,i.spotShadowMap[p]=j,v++}p++}else if(I.isRectAreaLight){let z=e.get(I);z.color.copy(P).multiplyScalar(H),z.halfWidth.set(.5*I.width,0,0),z.halfHeight.set(0,.5*I.height,0),i.rectArea[g]=z,g++}else if(I.isPointLight){let z=e.get(I);if(z.color.copy(I.color).multiplyScalar(I.intensity),z.distance=I.distance,z.decay=I.decay,I.castShadow){let k=I.shadow,q=t.get(I);q.shadowIntensity=k.intensity,q.shadowBias=k.bias,q.shadowNormalBias=k.normalBias,q.shadowRadius=k.radius,q.shadowMapSize=k.mapSize,q.shadowCameraNear=k.camera.near,q.shadowCameraFar=k.camera.far,i.pointShadow[f]=q,i.pointShadowMap[f]=j,i.pointShadowMatrix[f]=I.shadow.matrix,m++}i.point[f]=z,f++}else if(I.isHemisphereLight){let z=e.get(I);z.skyColor.copy(I.color).multiplyScalar(H),z.groundColor.copy(I.groundColor).multiplyScalar(H),i.hemi[d]=z,d++}}g>0&&(r.has("OES_texture_float_linear")===!0?(i.rectAreaLTC1=le.LTC_FLOAT_1,i.rectAreaLTC2=le.LTC_FLOAT_2):(i.rectAreaLTC1=le.LTC_HALF_1,i.rectAreaLTC2=le.LTC_HALF_2)),i.ambient[0]=l,i.ambient[1]=c,i.ambient[2]=h;let M=i.hash;M.directionalLength===u&&M.pointLength===f&&M.spotLength===p&&M.rectAreaLength===g&&M.hemiLength===d&&M.numDirectionalShadows===_&&M.numPointShadows===m&&M.numSpotShadows===v&&M.numSpotMaps===y&&M.numLightProbes===E||(i.directional.length=u,i.spot.length=p,i.rectArea.length=g,i.point.length=f,i.hemi.length=d,i.directionalShadow.length=_,i.directionalShadowMap.length=_,i.pointShadow.length=m,i.pointShadowMap.length=m,i.spotShadow.length=v,i.spotShadowMap.length=v,i.directionalShadowMatrix.length=_,i.pointShadowMatrix.length=m,i.spotLightMatrix.length=v+y-w,i.spotLightMap.length=y,i.numSpotLightShadowsWithMaps=w,i.numLightProbes=E,M.directionalLength=u,M.pointLength=f,M.spotLength=p,M.rectAreaLength=g,M.hemiLength=d,M.numDirectionalShadows=_,M.numPointShadows=m,M.numSpotShadows=v,M.numSpotMaps=y,M.numLightProbes=E,i.version=w0++)},setupView:function(o,l){let c=0,h=0,u=0,f=0,p=0,g=l.matrixWorldInverse;for(let d=0,_=o.length;d<_;d++){let m=o[d];if(m.isDirectionalLight){let v=i.directional[c];v.direction.setFromMatrixPosition(m.matrixWorld),n.setFromMatrixPosition(m.target.matrixWorld),v.direction.sub(n),v.direction.transformDirection(g),c++}else if(m.isSpotLight){let v=i.spot[u];v.position.setFromMatrixPosition(m.matrixWorld),v.position.applyMatrix4(g),v.direction.setFromMatrixPosition(m.matrixWorld),n.setFromMatrixPosition(m.target.matrixWorld),v.direction.sub(n),v.direction.transformDirection(g),u++}else if(m.isRectAreaLight){let v=i.rectArea[f];v.position.setFromMatrixPosition(m.matrixWorld),v.position.applyMatrix4(g),a.identity(),s.copy(m.matrixWorld),s.premultiply(g),a.extractRotation(s),v.halfWidth.set(.5*m.width,0,0),v.halfHeight.set(0,.5*m.height,0),v.halfWidth.applyMatrix4(a),v.halfHeight.applyMatrix4(a),f++}else if(m.isPointLight){let v=i.point[h];v.position.setFromMatrixPosition(m.matrixWorld),v.position.applyMatrix4(g),h++}else if(m.isHemisphereLight){let v=i.hemi[p];v.direction.setFromMatrixPosition(m.matrixWorld),v.direction.transformDirection(g),p++}}},state:i}}function xp(r){let e=new E0(r),t=[],i=[],n=[],s={lightsArray:t,shadowsArray:i,lightProbeGridArray:n,camera:null,lights:e,transmissionRenderTarget:{},textureUnits:0};return{init:function(a){s.camera=a,t.length=0,i.length=0,n.length=0},state:s,setupLights:function(){e.setup(t)},setupLightsView:function(a){e.setupView(t,a)},pushLight:function(a){t.push(a)},pushShadow:function(a){i.push(a)},pushLightProbeGrid:function(a){n.push(a)}}}function A0(r){let e=new WeakMap;return{get:function(t,i=0){let n=e.get(t),s;return n===void 0?(s=new xp(r),e.set(t,[s])):i>=n.length?(s=new xp(r),n.push(s)):s=n[i],s},dispose:function(){e=new WeakMap}}}var C0=[new A(1,0,0),new A(-1,0,0),new A(0,1,0),new A(0,-1,0),new A(0,0,1),new A(0,0,-1)],R0=[new A(0,-1,0),new A(0,-1,0),new A(0,0,1),new A(0,0,-1),new A(0,-1,0),new A(0,-1,0)],yp=new De,gs=new A,uh=new A;function I0(r,e,t){let i=new wn,n=new ne,s=new ne,a=new $e,o=new Ya,l=new Za,c={},h=t.maxTextureSize,u={[dr]:Wt,[Wt]:dr,[Ai]:Ai},f=new $t({defines:{VSM_SAMPLES:8},uniforms:{shadow_pass:{value:null},resolution:{value:new ne},radius:{value:4}},vertexShader:`void main() {
	gl_Position = vec4( position, 1.0 );
}`,fragmentShader:`uniform sampler2D shadow_pass;
uniform vec2 resolution;
uniform float radius;
void main() {
	const float samples = float( VSM_SAMPLES );
	float mean = 0.0;
	float squared_mean = 0.0;
	float uvStride = samples <= 1.0 ? 0.0 : 2.0 / ( samples - 1.0 );
	float uvStart = samples <= 1.0 ? 0.0 : - 1.0;
	for ( float i = 0.0; i < samples; i ++ ) {
		float uvOffset = uvStart + i * uvStride;
		#ifdef HORIZONTAL_PASS
			vec2 distribution = texture2D( shadow_pass, ( gl_FragCoord.xy + vec2( uvOffset, 0.0 ) * radius ) / resolution ).rg;
			mean += distribution.x;
			squared_mean += distribution.y * distribution.y + distribution.x * distribution.x;
		#else
			float depth = texture2D( shadow_pass, ( gl_FragCoord.xy + vec2( 0.0, uvOffset ) * radius ) / resolution ).r;
			mean += depth;
			squared_mean += depth * depth;
		#endif
	}
	mean = mean / samples;
	squared_mean = squared_mean / samples;
	float std_dev = sqrt( max( 0.0, squared_mean - mean * mean ) );
	gl_FragColor = vec4( mean, std_dev, 0.0, 1.0 );
}`}),p=f.clone();p.defines.HORIZONTAL_PASS=1;let g=new Je;g.setAttribute("position",new Et(new Float32Array([-1,-1,.5,3,-1,.5,-1,3,.5]),3));let d=new Ct(g,f),_=this;this.enabled=!1,this.autoUpdate=!0,this.needsUpdate=!1,this.type=ls;let m=this.type;function v(M,D){let F=e.update(d);f.defines.VSM_SAMPLES!==M.blurSamples&&(f.defines.VSM_SAMPLES=M.blurSamples,p.defines.VSM_SAMPLES=M.blurSamples,f.needsUpdate=!0,p.needsUpdate=!0),M.mapPass===null&&(M.mapPass=new kt(n.x,n.y,{format:Pn,type:Ci})),f.uniforms.shadow_pass.value=M.map.depthTexture,f.uniforms.resolution.value=M.mapSize,f.uniforms.radius.value=M.radius,r.setRenderTarget(M.mapPass),r.clear(),r.renderBufferDirect(D,null,F,f,d,null),p.uniforms.shadow_pass.value=M.mapPass.texture,p.uniforms.resolution.value=M.mapSize,p.uniforms.radius.value=M.radius,r.setRenderTarget(M.map),r.clear(),r.renderBufferDirect(D,null,F,p,d,null)}function y(M,D,F,I){let P=null,H=F.isPointLight===!0?M.customDistanceMaterial:M.customDepthMaterial;if(H!==void 0)P=H;else if(P=F.isPointLight===!0?l:o,r.localClippingEnabled&&D.clipShadows===!0&&Array.isArray(D.clippingPlanes)&&D.clippingPlanes.length!==0||D.displacementMap&&D.displacementScale!==0||D.alphaMap&&D.alphaTest>0||D.map&&D.alphaTest>0||D.alphaToCoverage===!0){let O=P.uuid,j=D.uuid,z=c[O];z===void 0&&(z={},c[O]=z);let k=z[j];k===void 0&&(k=P.clone(),z[j]=k,D.addEventListener("dispose",E)),P=k}return P.visible=D.visible,P.wireframe=D.wireframe,P.side=I===ur?D.shadowSide!==null?D.shadowSide:D.side:D.shadowSide!==null?D.shadowSide:u[D.side],P.alphaMap=D.alphaMap,P.alphaTest=D.alphaToCoverage===!0?.5:D.alphaTest,P.map=D.map,P.clipShadows=D.clipShadows,P.clippingPlanes=D.clippingPlanes,P.clipIntersection=D.clipIntersection,P.displacementMap=D.displacementMap,P.displacementScale=D.displacementScale,P.displacementBias=D.displacementBias,P.wireframeLinewidth=D.wireframeLinewidth,P.linewidth=D.linewidth,F.isPointLight===!0&&P.isMeshDistanceMaterial===!0&&(r.properties.get(P).light=F),P}function w(M,D,F,I,P){if(M.visible===!1)return;if(M.layers.test(D.layers)&&(M.isMesh||M.isLine||M.isPoints)&&(M.castShadow||M.receiveShadow&&P===ur)&&(!M.frustumCulled||i.intersectsObject(M))){M.modelViewMatrix.multiplyMatrices(F.matrixWorldInverse,M.matrixWorld);let O=e.update(M),j=M.material;if(Array.isArray(j)){let z=O.groups;for(let k=0,q=z.length;k<q;k++){let X=z[k],oe=j[X.materialIndex];if(oe&&oe.visible){let ue=y(M,oe,I,P);M.onBeforeShadow(r,M,D,F,O,ue,X),r.renderBufferDirect(F,null,O,ue,M,X),M.onAfterShadow(r,M,D,F,O,ue,X)}}}else if(j.visible){let z=y(M,j,I,P);M.onBeforeShadow(r,M,D,F,O,z,null),r.renderBufferDirect(F,null,O,z,M,null),M.onAfterShadow(r,M,D,F,O,z,null)}}let H=M.children;for(let O=0,j=H.length;O<j;O++)w(H[O],D,F,I,P)}function E(M){M.target.removeEventListener("dispose",E);for(let D in c){let F=c[D],I=M.target.uuid;I in F&&(F[I].dispose(),delete F[I])}}this.render=function(M,D,F){if(_.enabled===!1||_.autoUpdate===!1&&_.needsUpdate===!1||M.length===0)return;this.type===cd&&(we("WebGLShadowMap: PCFSoftShadowMap has been deprecated. Using PCFShadowMap instead."),this.type=ls);let I=r.getRenderTarget(),P=r.getActiveCubeFace(),H=r.getActiveMipmapLevel(),O=r.state;O.setBlending(ri),O.buffers.depth.getReversed()===!0?O.buffers.color.setClear(0,0,0,0):O.buffers.color.setClear(1,1,1,1),O.buffers.depth.setTest(!0),O.setScissorTest(!1);let j=m!==this.type;j&&D.traverse(function(z){z.material&&(Array.isArray(z.material)?z.material.forEach(k=>k.needsUpdate=!0):z.material.needsUpdate=!0)});for(let z=0,k=M.length;z<k;z++){let q=M[z],X=q.shadow;if(X===void 0){we("WebGLShadowMap:",q,"has no shadow.");continue}if(X.autoUpdate===!1&&X.needsUpdate===!1)continue;n.copy(X.mapSize);let oe=X.getFrameExtents();n.multiply(oe),s.copy(X.mapSize),(n.x>h||n.y>h)&&(n.x>h&&(s.x=Math.floor(h/oe.x),n.x=s.x*oe.x,X.mapSize.x=s.x),n.y>h&&(s.y=Math.floor(h/oe.y),n.y=s.y*oe.y,X.mapSize.y=s.y));let ue=r.state.buffers.depth.getReversed();if(X.camera._reversedDepth=ue,X.map===null||j===!0){if(X.map!==null&&(X.map.depthTexture!==null&&(X.map.depthTexture.dispose(),X.map.depthTexture=null),X.map.dispose()),this.type===ur){if(q.isPointLight){we("WebGLShadowMap: VSM shadow maps are not supported for PointLights. Use PCF or BasicShadowMap instead.");continue}X.map=new kt(n.x,n.y,{format:Pn,type:Ci,minFilter:wt,magFilter:wt,generateMipmaps:!1}),X.map.texture.name=q.name+".shadowMap",X.map.depthTexture=new Gi(n.x,n.y,gi),X.map.depthTexture.name=q.name+".shadowMapDepth",X.map.depthTexture.format=on,X.map.depthTexture.compareFunction=null,X.map.depthTexture.minFilter=At,X.map.depthTexture.magFilter=At}else q.isPointLight?(X.map=new Co(n.x),X.map.depthTexture=new wa(n.x,Vi)):(X.map=new kt(n.x,n.y),X.map.depthTexture=new Gi(n.x,n.y,Vi)),X.map.depthTexture.name=q.name+".shadowMap",X.map.depthTexture.format=on,this.type===ls?(X.map.depthTexture.compareFunction=ue?bo:So,X.map.depthTexture.minFilter=wt,X.map.depthTexture.magFilter=wt):(X.map.depthTexture.compareFunction=null,X.map.depthTexture.minFilter=At,X.map.depthTexture.magFilter=At);X.camera.updateProjectionMatrix()}let be=X.map.isWebGLCubeRenderTarget?6:1;for(let ye=0;ye<be;ye++){if(X.map.isWebGLCubeRenderTarget)r.setRenderTarget(X.map,ye),r.clear();else{ye===0&&(r.setRenderTarget(X.map),r.clear());let xe=X.getViewport(ye);a.set(s.x*xe.x,s.y*xe.y,s.x*xe.z,s.y*xe.w),O.viewport(a)}if(q.isPointLight){let xe=X.camera,ee=X.matrix,ae=q.distance||xe.far;ae!==xe.far&&(xe.far=ae,xe.updateProjectionMatrix()),gs.setFromMatrixPosition(q.matrixWorld),xe.position.copy(gs),uh.copy(xe.position),uh.add(C0[ye]),xe.up.copy(R0[ye]),xe.lookAt(uh),xe.updateMatrixWorld(),ee.makeTranslation(-gs.x,-gs.y,-gs.z),yp.multiplyMatrices(xe.projectionMatrix,xe.matrixWorldInverse),X._frustum.setFromProjectionMatrix(yp,xe.coordinateSystem,xe.reversedDepth)}else X.updateMatrices(q);i=X.getFrustum(),w(D,F,X.camera,q,this.type)}X.isPointLightShadow!==!0&&this.type===ur&&v(X,F),X.needsUpdate=!1}m=this.type,_.needsUpdate=!1,r.setRenderTarget(I,P,H)}}function P0(r,e){let t=new function(){let x=!1,L=new $e,U=null,T=new $e(0,0,0,0);return{setMask:function(V){U===V||x||(r.colorMask(V,V,V,V),U=V)},setLocked:function(V){x=V},setClear:function(V,W,$,Q,de){de===!0&&(V*=Q,W*=Q,$*=Q),L.set(V,W,$,Q),T.equals(L)===!1&&(r.clearColor(V,W,$,Q),T.copy(L))},reset:function(){x=!1,U=null,T.set(-1,0,0,0)}}},i=new function(){let x=!1,L=!1,U=null,T=null,V=null;return{setReversed:function(W){if(L!==W){let $=e.get("EXT_clip_control");W?$.clipControlEXT($.LOWER_LEFT_EXT,$.ZERO_TO_ONE_EXT):$.clipControlEXT($.LOWER_LEFT_EXT,$.NEGATIVE_ONE_TO_ONE_EXT),L=W;let Q=V;V=null,this.setClear(Q)}},getReversed:function(){return L},setTest:function(W){W?ie(r.DEPTH_TEST):ve(r.DEPTH_TEST)},setMask:function(W){U===W||x||(r.depthMask(W),U=W)},setFunc:function(W){if(L&&(W=jd[W]),T!==W){switch(W){case ic:r.depthFunc(r.NEVER);break;case nc:r.depthFunc(r.ALWAYS);break;case rc:r.depthFunc(r.LESS);break;case lo:r.depthFunc(r.LEQUAL);break;case sc:r.depthFunc(r.EQUAL);break;case ac:r.depthFunc(r.GEQUAL);break;case oc:r.depthFunc(r.GREATER);break;case lc:r.depthFunc(r.NOTEQUAL);break;default:r.depthFunc(r.LEQUAL)}T=W}},setLocked:function(W){x=W},setClear:function(W){V!==W&&(V=W,L&&(W=1-W),r.clearDepth(W))},reset:function(){x=!1,U=null,T=null,V=null,L=!1}}},n=new function(){let x=!1,L=null,U=null,T=null,V=null,W=null,$=null,Q=null,de=null;return{setTest:function(Z){x||(Z?ie(r.STENCIL_TEST):ve(r.STENCIL_TEST))},setMask:function(Z){L===Z||x||(r.stencilMask(Z),L=Z)},setFunc:function(Z,fe,ce){U===Z&&T===fe&&V===ce||(r.stencilFunc(Z,fe,ce),U=Z,T=fe,V=ce)},setOp:function(Z,fe,ce){W===Z&&$===fe&&Q===ce||(r.stencilOp(Z,fe,ce),W=Z,$=fe,Q=ce)},setLocked:function(Z){x=Z},setClear:function(Z){de!==Z&&(r.clearStencil(Z),de=Z)},reset:function(){x=!1,L=null,U=null,T=null,V=null,W=null,$=null,Q=null,de=null}}},s=new WeakMap,a=new WeakMap,o={},l={},c={},h=new WeakMap,u=[],f=null,p=!1,g=null,d=null,_=null,m=null,v=null,y=null,w=null,E=new je(0,0,0),M=0,D=!1,F=null,I=null,P=null,H=null,O=null,j=r.getParameter(r.MAX_COMBINED_TEXTURE_IMAGE_UNITS),z=!1,k=0,q=r.getParameter(r.VERSION);q.indexOf("WebGL")!==-1?(k=parseFloat(/^WebGL (\d)/.exec(q)[1]),z=k>=1):q.indexOf("OpenGL ES")!==-1&&(k=parseFloat(/^OpenGL ES (\d)/.exec(q)[1]),z=k>=2);let X=null,oe={},ue=r.getParameter(r.SCISSOR_BOX),be=r.getParameter(r.VIEWPORT),ye=new $e().fromArray(ue),xe=new $e().fromArray(be);function ee(x,L,U,T){let V=new Uint8Array(4),W=r.createTexture();r.bindTexture(x,W),r.texParameteri(x,r.TEXTURE_MIN_FILTER,r.NEAREST),r.texParameteri(x,r.TEXTURE_MAG_FILTER,r.NEAREST);for(let $=0;$<U;$++)x===r.TEXTURE_3D||x===r.TEXTURE_2D_ARRAY?r.texImage3D(L,0,r.RGBA,1,1,T,0,r.RGBA,r.UNSIGNED_BYTE,V):r.texImage2D(L+$,0,r.RGBA,1,1,0,r.RGBA,r.UNSIGNED_BYTE,V);return W}let ae={};function ie(x){o[x]!==!0&&(r.enable(x),o[x]=!0)}function ve(x){o[x]!==!1&&(r.disable(x),o[x]=!1)}ae[r.TEXTURE_2D]=ee(r.TEXTURE_2D,r.TEXTURE_2D,1),ae[r.TEXTURE_CUBE_MAP]=ee(r.TEXTURE_CUBE_MAP,r.TEXTURE_CUBE_MAP_POSITIVE_X,6),ae[r.TEXTURE_2D_ARRAY]=ee(r.TEXTURE_2D_ARRAY,r.TEXTURE_2D_ARRAY,1,1),ae[r.TEXTURE_3D]=ee(r.TEXTURE_3D,r.TEXTURE_3D,1,1),t.setClear(0,0,0,1),i.setClear(1),n.setClear(0),ie(r.DEPTH_TEST),i.setFunc(lo),S(!1),C(Jl),ie(r.CULL_FACE),R(ri);let ke={[pr]:r.FUNC_ADD,[ud]:r.FUNC_SUBTRACT,[dd]:r.FUNC_REVERSE_SUBTRACT};ke[pd]=r.MIN,ke[fd]=r.MAX;let te={[md]:r.ZERO,[gd]:r.ONE,[vd]:r.SRC_COLOR,[xd]:r.SRC_ALPHA,[Td]:r.SRC_ALPHA_SATURATE,[bd]:r.DST_COLOR,[Md]:r.DST_ALPHA,[_d]:r.ONE_MINUS_SRC_COLOR,[yd]:r.ONE_MINUS_SRC_ALPHA,[wd]:r.ONE_MINUS_DST_COLOR,[Sd]:r.ONE_MINUS_DST_ALPHA,[Ed]:r.CONSTANT_COLOR,[Ad]:r.ONE_MINUS_CONSTANT_COLOR,[Cd]:r.CONSTANT_ALPHA,[Rd]:r.ONE_MINUS_CONSTANT_ALPHA};function R(x,L,U,T,V,W,$,Q,de,Z){if(x!==ri){if(p===!1&&(ie(r.BLEND),p=!0),x===hd)V=V||L,W=W||U,$=$||T,L===d&&V===v||(r.blendEquationSeparate(ke[L],ke[V]),d=L,v=V),U===_&&T===m&&W===y&&$===w||(r.blendFuncSeparate(te[U],te[T],te[W],te[$]),_=U,m=T,y=W,w=$),Q.equals(E)!==!1&&de===M||(r.blendColor(Q.r,Q.g,Q.b,de),E.copy(Q),M=de),g=x,D=!1;else if(x!==g||Z!==D){if(d===pr&&v===pr||(r.blendEquation(r.FUNC_ADD),d=pr,v=pr),Z)switch(x){case cs:r.blendFuncSeparate(r.ONE,r.ONE_MINUS_SRC_ALPHA,r.ONE,r.ONE_MINUS_SRC_ALPHA);break;case Ql:r.blendFunc(r.ONE,r.ONE);break;case ec:r.blendFuncSeparate(r.ZERO,r.ONE_MINUS_SRC_COLOR,r.ZERO,r.ONE);break;case tc:r.blendFuncSeparate(r.DST_COLOR,r.ONE_MINUS_SRC_ALPHA,r.ZERO,r.ONE);break;default:Te("WebGLState: Invalid blending: ",x)}else switch(x){case cs:r.blendFuncSeparate(r.SRC_ALPHA,r.ONE_MINUS_SRC_ALPHA,r.ONE,r.ONE_MINUS_SRC_ALPHA);break;case Ql:r.blendFuncSeparate(r.SRC_ALPHA,r.ONE,r.ONE,r.ONE);break;case ec:Te("WebGLState: SubtractiveBlending requires material.premultipliedAlpha = true");break;case tc:Te("WebGLState: MultiplyBlending requires material.premultipliedAlpha = true");break;default:Te("WebGLState: Invalid blending: ",x)}_=null,m=null,y=null,w=null,E.set(0,0,0),M=0,g=x,D=Z}}else p===!0&&(ve(r.BLEND),p=!1)}function S(x){F!==x&&(x?r.frontFace(r.CW):r.frontFace(r.CCW),F=x)}function C(x){x!==od?(ie(r.CULL_FACE),x!==I&&(x===Jl?r.cullFace(r.BACK):x===ld?r.cullFace(r.FRONT):r.cullFace(r.FRONT_AND_BACK))):ve(r.CULL_FACE),I=x}function N(x,L,U){x?(ie(r.POLYGON_OFFSET_FILL),H===L&&O===U||(H=L,O=U,i.getReversed()&&(L=-L),r.polygonOffset(L,U))):ve(r.POLYGON_OFFSET_FILL)}return{buffers:{color:t,depth:i,stencil:n},enable:ie,disable:ve,bindFramebuffer:function(x,L){return c[x]!==L&&(r.bindFramebuffer(x,L),c[x]=L,x===r.DRAW_FRAMEBUFFER&&(c[r.FRAMEBUFFER]=L),x===r.FRAMEBUFFER&&(c[r.DRAW_FRAMEBUFFER]=L),!0)},drawBuffers:function(x,L){let U=u,T=!1;if(x){U=h.get(L),U===void 0&&(U=[],h.set(L,U));let V=x.textures;if(U.length!==V.length||U[0]!==r.COLOR_ATTACHMENT0){for(let W=0,$=V.length;W<$;W++)U[W]=r.COLOR_ATTACHMENT0+W;U.length=V.length,T=!0}}else U[0]!==r.BACK&&(U[0]=r.BACK,T=!0);T&&r.drawBuffers(U)},useProgram:function(x){return f!==x&&(r.useProgram(x),f=x,!0)},setBlending:R,setMaterial:function(x,L){x.side===Ai?ve(r.CULL_FACE):ie(r.CULL_FACE);let U=x.side===Wt;L&&(U=!U),S(U),x.blending===cs&&x.transparent===!1?R(ri):R(x.blending,x.blendEquation,x.blendSrc,x.blendDst,x.blendEquationAlpha,x.blendSrcAlpha,x.blendDstAlpha,x.blendColor,x.blendAlpha,x.premultipliedAlpha),i.setFunc(x.depthFunc),i.setTest(x.depthTest),i.setMask(x.depthWrite),t.setMask(x.colorWrite);let T=x.stencilWrite;n.setTest(T),T&&(n.setMask(x.stencilWriteMask),n.setFunc(x.stencilFunc,x.stencilRef,x.stencilFuncMask),n.setOp(x.stencilFail,x.stencilZFail,x.stencilZPass)),N(x.polygonOffset,x.polygonOffsetFactor,x.polygonOffsetUnits),x.alphaToCoverage===!0?ie(r.SAMPLE_ALPHA_TO_COVERAGE):ve(r.SAMPLE_ALPHA_TO_COVERAGE)},setFlipSided:S,setCullFace:C,setLineWidth:function(x){x!==P&&(z&&r.lineWidth(x),P=x)},setPolygonOffset:N,setScissorTest:function(x){x?ie(r.SCISSOR_TEST):ve(r.SCISSOR_TEST)},activeTexture:function(x){x===void 0&&(x=r.TEXTURE0+j-1),X!==x&&(r.activeTexture(x),X=x)},bindTexture:function(x,L,U){U===void 0&&(U=X===null?r.TEXTURE0+j-1:X);let T=oe[U];T===void 0&&(T={type:void 0,texture:void 0},oe[U]=T),T.type===x&&T.texture===L||(X!==U&&(r.activeTexture(U),X=U),r.bindTexture(x,L||ae[x]),T.type=x,T.texture=L)},unbindTexture:function(){let x=oe[X];x!==void 0&&x.type!==void 0&&(r.bindTexture(x.type,null),x.type=void 0,x.texture=void 0)},compressedTexImage2D:function(){try{r.compressedTexImage2D(...arguments)}catch(x){Te("WebGLState:",x)}},compressedTexImage3D:function(){try{r.compressedTexImage3D(...arguments)}catch(x){Te("WebGLState:",x)}},texImage2D:function(){try{r.texImage2D(...arguments)}catch(x){Te("WebGLState:",x)}},texImage3D:function(){try{r.texImage3D(...arguments)}catch(x){Te("WebGLState:",x)}},pixelStorei:function(x,L){l[x]!==L&&(r.pixelStorei(x,L),l[x]=L)},getParameter:function(x){return l[x]!==void 0?l[x]:r.getParameter(x)},updateUBOMapping:function(x,L){let U=a.get(L);U===void 0&&(U=new WeakMap,a.set(L,U));let T=U.get(x);T===void 0&&(T=r.getUniformBlockIndex(L,x.name),U.set(x,T))},uniformBlockBinding:function(x,L){let U=a.get(L).get(x);s.get(L)!==U&&(r.uniformBlockBinding(L,U,x.__bindingPointIndex),s.set(L,U))},texStorage2D:function(){try{r.texStorage2D(...arguments)}catch(x){Te("WebGLState:",x)}},texStorage3D:function(){try{r.texStorage3D(...arguments)}catch(x){Te("WebGLState:",x)}},texSubImage2D:function(){try{r.texSubImage2D(...arguments)}catch(x){Te("WebGLState:",x)}},texSubImage3D:function(){try{r.texSubImage3D(...arguments)}catch(x){Te("WebGLState:",x)}},compressedTexSubImage2D:function(){try{r.compressedTexSubImage2D(...arguments)}catch(x){Te("WebGLState:",x)}},compressedTexSubImage3D:function(){try{r.compressedTexSubImage3D(...arguments)}catch(x){Te("WebGLState:",x)}},scissor:function(x){ye.equals(x)===!1&&(r.scissor(x.x,x.y,x.z,x.w),ye.copy(x))},viewport:function(x){xe.equals(x)===!1&&(r.viewport(x.x,x.y,x.z,x.w),xe.copy(x))},reset:function(){r.disable(r.BLEND),r.disable(r.CULL_FACE),r.disable(r.DEPTH_TEST),r.disable(r.POLYGON_OFFSET_FILL),r.disable(r.SCISSOR_TEST),r.disable(r.STENCIL_TEST),r.disable(r.SAMPLE_ALPHA_TO_COVERAGE),r.blendEquation(r.FUNC_ADD),r.blendFunc(r.ONE,r.ZERO),r.blendFuncSeparate(r.ONE,r.ZERO,r.ONE,r.ZERO),r.blendColor(0,0,0,0),r.colorMask(!0,!0,!0,!0),r.clearColor(0,0,0,0),r.depthMask(!0),r.depthFunc(r.LESS),i.setReversed(!1),r.clearDepth(1),r.stencilMask(4294967295),r.stencilFunc(r.ALWAYS,0,4294967295),r.stencilOp(r.KEEP,r.KEEP,r.KEEP),r.clearStencil(0),r.cullFace(r.BACK),r.frontFace(r.CCW),r.polygonOffset(0,0),r.activeTexture(r.TEXTURE0),r.bindFramebuffer(r.FRAMEBUFFER,null),r.bindFramebuffer(r.DRAW_FRAMEBUFFER,null),r.bindFramebuffer(r.READ_FRAMEBUFFER,null),r.useProgram(null),r.lineWidth(1),r.scissor(0,0,r.canvas.width,r.canvas.height),r.viewport(0,0,r.canvas.width,r.canvas.height),r.pixelStorei(r.PACK_ALIGNMENT,4),r.pixelStorei(r.UNPACK_ALIGNMENT,4),r.pixelStorei(r.UNPACK_FLIP_Y_WEBGL,!1),r.pixelStorei(r.UNPACK_PREMULTIPLY_ALPHA_WEBGL,!1),r.pixelStorei(r.UNPACK_COLORSPACE_CONVERSION_WEBGL,r.BROWSER_DEFAULT_WEBGL),r.pixelStorei(r.PACK_ROW_LENGTH,0),r.pixelStorei(r.PACK_SKIP_PIXELS,0),r.pixelStorei(r.PACK_SKIP_ROWS,0),r.pixelStorei(r.UNPACK_ROW_LENGTH,0),r.pixelStorei(r.UNPACK_IMAGE_HEIGHT,0),r.pixelStorei(r.UNPACK_SKIP_PIXELS,0),r.pixelStorei(r.UNPACK_SKIP_ROWS,0),r.pixelStorei(r.UNPACK_SKIP_IMAGES,0),o={},l={},X=null,oe={},c={},h=new WeakMap,u=[],f=null,p=!1,g=null,d=null,_=null,m=null,v=null,y=null,w=null,E=new je(0,0,0),M=0,D=!1,F=null,I=null,P=null,H=null,O=null,ye.set(0,0,r.canvas.width,r.canvas.height),xe.set(0,0,r.canvas.width,r.canvas.height),t.reset(),i.reset(),n.reset()}}}function L0(r,e,t,i,n,s,a){let o=e.has("WEBGL_multisampled_render_to_texture")?e.get("WEBGL_multisampled_render_to_texture"):null,l=typeof navigator<"u"&&/OculusBrowser/g.test(navigator.userAgent),c=new ne,h=new WeakMap,u=new Set,f,p=new WeakMap,g=!1;try{g=typeof OffscreenCanvas<"u"&&new OffscreenCanvas(1,1).getContext("2d")!==null}catch{}function d(R,S){return g?new OffscreenCanvas(R,S):Gr("canvas")}function _(R,S,C){let N=1,x=te(R);if((x.width>C||x.height>C)&&(N=C/Math.max(x.width,x.height)),N<1){if(typeof HTMLImageElement<"u"&&R instanceof HTMLImageElement||typeof HTMLCanvasElement<"u"&&R instanceof HTMLCanvasElement||typeof ImageBitmap<"u"&&R instanceof ImageBitmap||typeof VideoFrame<"u"&&R instanceof VideoFrame){let L=Math.floor(N*x.width),U=Math.floor(N*x.height);f===void 0&&(f=d(L,U));let T=S?d(L,U):f;return T.width=L,T.height=U,T.getContext("2d").drawImage(R,0,0,L,U),we("WebGLRenderer: Texture has been resized from ("+x.width+"x"+x.height+") to ("+L+"x"+U+")."),T}return"data"in R&&we("WebGLRenderer: Image in DataTexture is too big ("+x.width+"x"+x.height+")."),R}return R}function m(R){return R.generateMipmaps}function v(R){r.generateMipmap(R)}function y(R){return R.isWebGLCubeRenderTarget?r.TEXTURE_CUBE_MAP:R.isWebGL3DRenderTarget?r.TEXTURE_3D:R.isWebGLArrayRenderTarget||R.isCompressedArrayTexture?r.TEXTURE_2D_ARRAY:r.TEXTURE_2D}function w(R,S,C,N,x,L=!1){if(R!==null){if(r[R]!==void 0)return r[R];we("WebGLRenderer: Attempt to use non-existing WebGL internal format '"+R+"'")}let U;N&&(U=e.get("EXT_texture_norm16"),U||we("WebGLRenderer: Unable to use normalized textures without EXT_texture_norm16 extension"));let T=S;if(S===r.RED&&(C===r.FLOAT&&(T=r.R32F),C===r.HALF_FLOAT&&(T=r.R16F),C===r.UNSIGNED_BYTE&&(T=r.R8),C===r.UNSIGNED_SHORT&&U&&(T=U.R16_EXT),C===r.SHORT&&U&&(T=U.R16_SNORM_EXT)),S===r.RED_INTEGER&&(C===r.UNSIGNED_BYTE&&(T=r.R8UI),C===r.UNSIGNED_SHORT&&(T=r.R16UI),C===r.UNSIGNED_INT&&(T=r.R32UI),C===r.BYTE&&(T=r.R8I),C===r.SHORT&&(T=r.R16I),C===r.INT&&(T=r.R32I)),S===r.RG&&(C===r.FLOAT&&(T=r.RG32F),C===r.HALF_FLOAT&&(T=r.RG16F),C===r.UNSIGNED_BYTE&&(T=r.RG8),C===r.UNSIGNED_SHORT&&U&&(T=U.RG16_EXT),C===r.SHORT&&U&&(T=U.RG16_SNORM_EXT)),S===r.RG_INTEGER&&(C===r.UNSIGNED_BYTE&&(T=r.RG8UI),C===r.UNSIGNED_SHORT&&(T=r.RG16UI),C===r.UNSIGNED_INT&&(T=r.RG32UI),C===r.BYTE&&(T=r.RG8I),C===r.SHORT&&(T=r.RG16I),C===r.INT&&(T=r.RG32I)),S===r.RGB_INTEGER&&(C===r.UNSIGNED_BYTE&&(T=r.RGB8UI),C===r.UNSIGNED_SHORT&&(T=r.RGB16UI),C===r.UNSIGNED_INT&&(T=r.RGB32UI),C===r.BYTE&&(T=r.RGB8I),C===r.SHORT&&(T=r.RGB16I),C===r.INT&&(T=r.RGB32I)),S===r.RGBA_INTEGER&&(C===r.UNSIGNED_BYTE&&(T=r.RGBA8UI),C===r.UNSIGNED_SHORT&&(T=r.RGBA16UI),C===r.UNSIGNED_INT&&(T=r.RGBA32UI),C===r.BYTE&&(T=r.RGBA8I),C===r.SHORT&&(T=r.RGBA16I),C===r.INT&&(T=r.RGBA32I)),S===r.RGB&&(C===r.UNSIGNED_SHORT&&U&&(T=U.RGB16_EXT),C===r.SHORT&&U&&(T=U.RGB16_SNORM_EXT),C===r.UNSIGNED_INT_5_9_9_9_REV&&(T=r.RGB9_E5),C===r.UNSIGNED_INT_10F_11F_11F_REV&&(T=r.R11F_G11F_B10F)),S===r.RGBA){let V=L?kr:Ve.getTransfer(x);C===r.FLOAT&&(T=r.RGBA32F),C===r.HALF_FLOAT&&(T=r.RGBA16F),C===r.UNSIGNED_BYTE&&(T=V===Ke?r.SRGB8_ALPHA8:r.RGBA8),C===r.UNSIGNED_SHORT&&U&&(T=U.RGBA16_EXT),C===r.SHORT&&U&&(T=U.RGBA16_SNORM_EXT),C===r.UNSIGNED_SHORT_4_4_4_4&&(T=r.RGBA4),C===r.UNSIGNED_SHORT_5_5_5_1&&(T=r.RGB5_A1)}return T!==r.R16F&&T!==r.R32F&&T!==r.RG16F&&T!==r.RG32F&&T!==r.RGBA16F&&T!==r.RGBA32F||e.get("EXT_color_buffer_float"),T}function E(R,S){let C;return R?S===null||S===Vi||S===mr?C=r.DEPTH24_STENCIL8:S===gi?C=r.DEPTH32F_STENCIL8:S===an&&(C=r.DEPTH24_STENCIL8,we("DepthTexture: 16 bit depth attachment is not supported with stencil. Using 24-bit attachment.")):S===null||S===Vi||S===mr?C=r.DEPTH_COMPONENT24:S===gi?C=r.DEPTH_COMPONENT32F:S===an&&(C=r.DEPTH_COMPONENT16),C}function M(R,S){return m(R)===!0||R.isFramebufferTexture&&R.minFilter!==At&&R.minFilter!==wt?Math.log2(Math.max(S.width,S.height))+1:R.mipmaps!==void 0&&R.mipmaps.length>0?R.mipmaps.length:R.isCompressedTexture&&Array.isArray(R.image)?S.mipmaps.length:1}function D(R){let S=R.target;S.removeEventListener("dispose",D),(function(C){let N=i.get(C);if(N.__webglInit===void 0)return;let x=C.source,L=p.get(x);if(L){let U=L[N.__cacheKey];U.usedTimes--,U.usedTimes===0&&I(C),Object.keys(L).length===0&&p.delete(x)}i.remove(C)})(S),S.isVideoTexture&&h.delete(S),S.isHTMLTexture&&u.delete(S)}function F(R){let S=R.target;S.removeEventListener("dispose",F),(function(C){let N=i.get(C);if(C.depthTexture&&(C.depthTexture.dispose(),i.remove(C.depthTexture)),C.isWebGLCubeRenderTarget)for(let L=0;L<6;L++){if(Array.isArray(N.__webglFramebuffer[L]))for(let U=0;U<N.__webglFramebuffer[L].length;U++)r.deleteFramebuffer(N.__webglFramebuffer[L][U]);else r.deleteFramebuffer(N.__webglFramebuffer[L]);N.__webglDepthbuffer&&r.deleteRenderbuffer(N.__webglDepthbuffer[L])}else{if(Array.isArray(N.__webglFramebuffer))for(let L=0;L<N.__webglFramebuffer.length;L++)r.deleteFramebuffer(N.__webglFramebuffer[L]);else r.deleteFramebuffer(N.__webglFramebuffer);if(N.__webglDepthbuffer&&r.deleteRenderbuffer(N.__webglDepthbuffer),N.__webglMultisampledFramebuffer&&r.deleteFramebuffer(N.__webglMultisampledFramebuffer),N.__webglColorRenderbuffer)for(let L=0;L<N.__webglColorRenderbuffer.length;L++)N.__webglColorRenderbuffer[L]&&r.deleteRenderbuffer(N.__webglColorRenderbuffer[L]);N.__webglDepthRenderbuffer&&r.deleteRenderbuffer(N.__webglDepthRenderbuffer)}let x=C.textures;for(let L=0,U=x.length;L<U;L++){let T=i.get(x[L]);T.__webglTexture&&(r.deleteTexture(T.__webglTexture),a.memory.textures--),i.remove(x[L])}i.remove(C)})(S)}function I(R){let S=i.get(R);r.deleteTexture(S.__webglTexture);let C=R.source;delete p.get(C)[S.__cacheKey],a.memory.textures--}let P=0;function H(R,S){let C=i.get(R);if(R.isVideoTexture&&(function(N){let x=a.render.frame;h.get(N)!==x&&(h.set(N,x),N.update())})(R),R.isRenderTargetTexture===!1&&R.isExternalTexture!==!0&&R.version>0&&C.__version!==R.version){let N=R.image;if(N===null)we("WebGLRenderer: Texture marked for update but no image data found.");else{if(N.complete!==!1)return void oe(C,R,S);we("WebGLRenderer: Texture marked for update but image is incomplete")}}else R.isExternalTexture&&(C.__webglTexture=R.sourceTexture?R.sourceTexture:null);t.bindTexture(r.TEXTURE_2D,C.__webglTexture,r.TEXTURE0+S)}let O={[ma]:r.REPEAT,[di]:r.CLAMP_TO_EDGE,[ga]:r.MIRRORED_REPEAT},j={[At]:r.NEAREST,[Ud]:r.NEAREST_MIPMAP_NEAREST,[us]:r.NEAREST_MIPMAP_LINEAR,[wt]:r.LINEAR,[uo]:r.LINEAR_MIPMAP_NEAREST,[Cn]:r.LINEAR_MIPMAP_LINEAR},z={[Od]:r.NEVER,[Vd]:r.ALWAYS,[Bd]:r.LESS,[So]:r.LEQUAL,[kd]:r.EQUAL,[bo]:r.GEQUAL,[zd]:r.GREATER,[Gd]:r.NOTEQUAL};function k(R,S){if(S.type!==gi||e.has("OES_texture_float_linear")!==!1||S.magFilter!==wt&&S.magFilter!==uo&&S.magFilter!==us&&S.magFilter!==Cn&&S.minFilter!==wt&&S.minFilter!==uo&&S.minFilter!==us&&S.minFilter!==Cn||we("WebGLRenderer: Unable to use linear filtering with floating point textures. OES_texture_float_linear not supported on this device."),r.texParameteri(R,r.TEXTURE_WRAP_S,O[S.wrapS]),r.texParameteri(R,r.TEXTURE_WRAP_T,O[S.wrapT]),R!==r.TEXTURE_3D&&R!==r.TEXTURE_2D_ARRAY||r.texParameteri(R,r.TEXTURE_WRAP_R,O[S.wrapR]),r.texParameteri(R,r.TEXTURE_MAG_FILTER,j[S.magFilter]),r.texParameteri(R,r.TEXTURE_MIN_FILTER,j[S.minFilter]),S.compareFunction&&(r.texParameteri(R,r.TEXTURE_COMPARE_MODE,r.COMPARE_REF_TO_TEXTURE),r.texParameteri(R,r.TEXTURE_COMPARE_FUNC,z[S.compareFunction])),e.has("EXT_texture_filter_anisotropic")===!0){if(S.magFilter===At||S.minFilter!==us&&S.minFilter!==Cn||S.type===gi&&e.has("OES_texture_float_linear")===!1)return;if(S.anisotropy>1||i.get(S).__currentAnisotropy){let C=e.get("EXT_texture_filter_anisotropic");r.texParameterf(R,C.TEXTURE_MAX_ANISOTROPY_EXT,Math.min(S.anisotropy,n.getMaxAnisotropy())),i.get(S).__currentAnisotropy=S.anisotropy}}}function q(R,S){let C=!1;R.__webglInit===void 0&&(R.__webglInit=!0,S.addEventListener("dispose",D));let N=S.source,x=p.get(N);x===void 0&&(x={},p.set(N,x));let L=(function(U){let T=[];return T.push(U.wrapS),T.push(U.wrapT),T.push(U.wrapR||0),T.push(U.magFilter),T.push(U.minFilter),T.push(U.anisotropy),T.push(U.internalFormat),T.push(U.format),T.push(U.type),T.push(U.generateMipmaps),T.push(U.premultiplyAlpha),T.push(U.flipY),T.push(U.unpackAlignment),T.push(U.colorSpace),T.join()})(S);if(L!==R.__cacheKey){x[L]===void 0&&(x[L]={texture:r.createTexture(),usedTimes:0},a.memory.textures++,C=!0),x[L].usedTimes++;let U=x[R.__cacheKey];U!==void 0&&(x[R.__cacheKey].usedTimes--,U.usedTimes===0&&I(S)),R.__cacheKey=L,R.__webglTexture=x[L].texture}return C}function X(R,S,C){return Math.floor(Math.floor(R/C)/S)}function oe(R,S,C){let N=r.TEXTURE_2D;(S.isDataArrayTexture||S.isCompressedArrayTexture)&&(N=r.TEXTURE_2D_ARRAY),S.isData3DTexture&&(N=r.TEXTURE_3D);let x=q(R,S),L=S.source;t.bindTexture(N,R.__webglTexture,r.TEXTURE0+C);let U=i.get(L);if(L.version!==U.__version||x===!0){if(t.activeTexture(r.TEXTURE0+C),!(typeof ImageBitmap<"u"&&S.image instanceof ImageBitmap)){let se=Ve.getPrimaries(Ve.workingColorSpace),Me=S.colorSpace===Ri?null:Ve.getPrimaries(S.colorSpace),ze=S.colorSpace===Ri||se===Me?r.NONE:r.BROWSER_DEFAULT_WEBGL;t.pixelStorei(r.UNPACK_FLIP_Y_WEBGL,S.flipY),t.pixelStorei(r.UNPACK_PREMULTIPLY_ALPHA_WEBGL,S.premultiplyAlpha),t.pixelStorei(r.UNPACK_COLORSPACE_CONVERSION_WEBGL,ze)}t.pixelStorei(r.UNPACK_ALIGNMENT,S.unpackAlignment);let T=_(S.image,!1,n.maxTextureSize);T=ke(S,T);let V=s.convert(S.format,S.colorSpace),W=s.convert(S.type),$,Q=w(S.internalFormat,V,W,S.normalized,S.colorSpace,S.isVideoTexture);k(N,S);let de=S.mipmaps,Z=S.isVideoTexture!==!0,fe=U.__version===void 0||x===!0,ce=L.dataReady,pe=M(S,T);if(S.isDepthTexture)Q=E(S.format===Rn,S.type),fe&&(Z?t.texStorage2D(r.TEXTURE_2D,1,Q,T.width,T.height):t.texImage2D(r.TEXTURE_2D,0,Q,T.width,T.height,0,V,W,null));else if(S.isDataTexture)if(de.length>0){Z&&fe&&t.texStorage2D(r.TEXTURE_2D,pe,Q,de[0].width,de[0].height);for(let se=0,Me=de.length;se<Me;se++)$=de[se],Z?ce&&t.texSubImage2D(r.TEXTURE_2D,se,0,0,$.width,$.height,V,W,$.data):t.texImage2D(r.TEXTURE_2D,se,Q,$.width,$.height,0,V,W,$.data);S.generateMipmaps=!1}else Z?(fe&&t.texStorage2D(r.TEXTURE_2D,pe,Q,T.width,T.height),ce&&(function(se,Me,ze,nt){let qe=se.updateRanges;if(qe.length===0)t.texSubImage2D(r.TEXTURE_2D,0,0,0,Me.width,Me.height,ze,nt,Me.data);else{qe.sort((Ce,tt)=>Ce.start-tt.start);let rt=0;for(let Ce=1;Ce<qe.length;Ce++){let tt=qe[rt],Pt=qe[Ce],vi=tt.start+tt.count,Qt=X(Pt.start,Me.width,4),_t=X(tt.start,Me.width,4);Pt.start<=vi+1&&Qt===_t&&X(Pt.start+Pt.count-1,Me.width,4)===Qt?tt.count=Math.max(tt.count,Pt.start+Pt.count-tt.start):(++rt,qe[rt]=Pt)}qe.length=rt+1;let Ft=t.getParameter(r.UNPACK_ROW_LENGTH),Se=t.getParameter(r.UNPACK_SKIP_PIXELS),Oe=t.getParameter(r.UNPACK_SKIP_ROWS);t.pixelStorei(r.UNPACK_ROW_LENGTH,Me.width);for(let Ce=0,tt=qe.length;Ce<tt;Ce++){let Pt=qe[Ce],vi=Math.floor(Pt.start/4),Qt=Math.ceil(Pt.count/4),_t=vi%Me.width,Gt=Math.floor(vi/Me.width),Nn=Qt;t.pixelStorei(r.UNPACK_SKIP_PIXELS,_t),t.pixelStorei(r.UNPACK_SKIP_ROWS,Gt),t.texSubImage2D(r.TEXTURE_2D,0,_t,Gt,Nn,1,ze,nt,Me.data)}se.clearUpdateRanges(),t.pixelStorei(r.UNPACK_ROW_LENGTH,Ft),t.pixelStorei(r.UNPACK_SKIP_PIXELS,Se),t.pixelStorei(r.UNPACK_SKIP_ROWS,Oe)}})(S,T,V,W)):t.texImage2D(r.TEXTURE_2D,0,Q,T.width,T.height,0,V,W,T.data);else if(S.isCompressedTexture)if(S.isCompressedArrayTexture){Z&&fe&&t.texStorage3D(r.TEXTURE_2D_ARRAY,pe,Q,de[0].width,de[0].height,T.depth);for(let se=0,Me=de.length;se<Me;se++)if($=de[se],S.format!==Jt)if(V!==null)if(Z){if(ce)if(S.layerUpdates.size>0){let ze=sh($.width,$.height,S.format,S.type);for(let nt of S.layerUpdates){let qe=$.data.subarray(nt*ze/$.data.BYTES_PER_ELEMENT,(nt+1)*ze/$.data.BYTES_PER_ELEMENT);t.compressedTexSubImage3D(r.TEXTURE_2D_ARRAY,se,0,0,nt,$.width,$.height,1,V,qe)}S.clearLayerUpdates()}else t.compressedTexSubImage3D(r.TEXTURE_2D_ARRAY,se,0,0,0,$.width,$.height,T.depth,V,$.data)}else t.compressedTexImage3D(r.TEXTURE_2D_ARRAY,se,Q,$.width,$.height,T.depth,0,$.data,0,0);else we("WebGLRenderer: Attempt to load unsupported compressed texture format in .uploadTexture()");else Z?ce&&t.texSubImage3D(r.TEXTURE_2D_ARRAY,se,0,0,0,$.width,$.height,T.depth,V,W,$.data):t.texImage3D(r.TEXTURE_2D_ARRAY,se,Q,$.width,$.height,T.depth,0,V,W,$.data)}else{Z&&fe&&t.texStorage2D(r.TEXTURE_2D,pe,Q,de[0].width,de[0].height);for(let se=0,Me=de.length;se<Me;se++)$=de[se],S.format!==Jt?V!==null?Z?ce&&t.compressedTexSubImage2D(r.TEXTURE_2D,se,0,0,$.width,$.height,V,$.data):t.compressedTexImage2D(r.TEXTURE_2D,se,Q,$.width,$.height,0,$.data):we("WebGLRenderer: Attempt to load unsupported compressed texture format in .uploadTexture()"):Z?ce&&t.texSubImage2D(r.TEXTURE_2D,se,0,0,$.width,$.height,V,W,$.data):t.texImage2D(r.TEXTURE_2D,se,Q,$.width,$.height,0,V,W,$.data)}else if(S.isDataArrayTexture)if(Z){if(fe&&t.texStorage3D(r.TEXTURE_2D_ARRAY,pe,Q,T.width,T.height,T.depth),ce)if(S.layerUpdates.size>0){let se=sh(T.width,T.height,S.format,S.type);for(let Me of S.layerUpdates){let ze=T.data.subarray(Me*se/T.data.BYTES_PER_ELEMENT,(Me+1)*se/T.data.BYTES_PER_ELEMENT);t.texSubImage3D(r.TEXTURE_2D_ARRAY,0,0,0,Me,T.width,T.height,1,V,W,ze)}S.clearLayerUpdates()}else t.texSubImage3D(r.TEXTURE_2D_ARRAY,0,0,0,0,T.width,T.height,T.depth,V,W,T.data)}else t.texImage3D(r.TEXTURE_2D_ARRAY,0,Q,T.width,T.height,T.depth,0,V,W,T.data);else if(S.isData3DTexture)Z?(fe&&t.texStorage3D(r.TEXTURE_3D,pe,Q,T.width,T.height,T.depth),ce&&t.texSubImage3D(r.TEXTURE_3D,0,0,0,0,T.width,T.height,T.depth,V,W,T.data)):t.texImage3D(r.TEXTURE_3D,0,Q,T.width,T.height,T.depth,0,V,W,T.data);else if(S.isFramebufferTexture){if(fe)if(Z)t.texStorage2D(r.TEXTURE_2D,pe,Q,T.width,T.height);else{let se=T.width,Me=T.height;for(let ze=0;ze<pe;ze++)t.texImage2D(r.TEXTURE_2D,ze,Q,se,Me,0,V,W,null),se>>=1,Me>>=1}}else if(S.isHTMLTexture){if("texElementImage2D"in r){let se=r.canvas;if(se.hasAttribute("layoutsubtree")||se.setAttribute("layoutsubtree","true"),T.parentNode!==se)return se.appendChild(T),u.add(S),se.onpaint=rt=>{let Ft=rt.changedElements;for(let Se of u)Ft.includes(Se.image)&&(Se.needsUpdate=!0)},void se.requestPaint();let Me=0,ze=r.RGBA,nt=r.RGBA,qe=r.UNSIGNED_BYTE;r.texElementImage2D(r.TEXTURE_2D,Me,ze,nt,qe,T),r.texParameteri(r.TEXTURE_2D,r.TEXTURE_MIN_FILTER,r.LINEAR),r.texParameteri(r.TEXTURE_2D,r.TEXTURE_WRAP_S,r.CLAMP_TO_EDGE),r.texParameteri(r.TEXTURE_2D,r.TEXTURE_WRAP_T,r.CLAMP_TO_EDGE)}}else if(de.length>0){if(Z&&fe){let se=te(de[0]);t.texStorage2D(r.TEXTURE_2D,pe,Q,se.width,se.height)}for(let se=0,Me=de.length;se<Me;se++)$=de[se],Z?ce&&t.texSubImage2D(r.TEXTURE_2D,se,0,0,V,W,$):t.texImage2D(r.TEXTURE_2D,se,Q,V,W,$);S.generateMipmaps=!1}else if(Z){if(fe){let se=te(T);t.texStorage2D(r.TEXTURE_2D,pe,Q,se.width,se.height)}ce&&t.texSubImage2D(r.TEXTURE_2D,0,0,0,V,W,T)}else t.texImage2D(r.TEXTURE_2D,0,Q,V,W,T);m(S)&&v(N),U.__version=L.version,S.onUpdate&&S.onUpdate(S)}R.__version=S.version}function ue(R,S,C,N,x,L){let U=s.convert(C.format,C.colorSpace),T=s.convert(C.type),V=w(C.internalFormat,U,T,C.normalized,C.colorSpace),W=i.get(S),$=i.get(C);if($.__renderTarget=S,!W.__hasExternalTextures){let Q=Math.max(1,S.width>>L),de=Math.max(1,S.height>>L);x===r.TEXTURE_3D||x===r.TEXTURE_2D_ARRAY?t.texImage3D(x,L,V,Q,de,S.depth,0,U,T,null):t.texImage2D(x,L,V,Q,de,0,U,T,null)}t.bindFramebuffer(r.FRAMEBUFFER,R),ve(S)?o.framebufferTexture2DMultisampleEXT(r.FRAMEBUFFER,N,x,$.__webglTexture,0,ie(S)):(x===r.TEXTURE_2D||x>=r.TEXTURE_CUBE_MAP_POSITIVE_X&&x<=r.TEXTURE_CUBE_MAP_NEGATIVE_Z)&&r.framebufferTexture2D(r.FRAMEBUFFER,N,x,$.__webglTexture,L),t.bindFramebuffer(r.FRAMEBUFFER,null)}function be(R,S,C){if(r.bindRenderbuffer(r.RENDERBUFFER,R),S.depthBuffer){let N=S.depthTexture,x=N&&N.isDepthTexture?N.type:null,L=E(S.stencilBuffer,x),U=S.stencilBuffer?r.DEPTH_STENCIL_ATTACHMENT:r.DEPTH_ATTACHMENT;ve(S)?o.renderbufferStorageMultisampleEXT(r.RENDERBUFFER,ie(S),L,S.width,S.height):C?r.renderbufferStorageMultisample(r.RENDERBUFFER,ie(S),L,S.width,S.height):r.renderbufferStorage(r.RENDERBUFFER,L,S.width,S.height),r.framebufferRenderbuffer(r.FRAMEBUFFER,U,r.RENDERBUFFER,R)}else{let N=S.textures;for(let x=0;x<N.length;x++){let L=N[x],U=s.convert(L.format,L.colorSpace),T=s.convert(L.type),V=w(L.internalFormat,U,T,L.normalized,L.colorSpace);ve(S)?o.renderbufferStorageMultisampleEXT(r.RENDERBUFFER,ie(S),V,S.width,S.height):C?r.renderbufferStorageMultisample(r.RENDERBUFFER,ie(S),V,S.width,S.height):r.renderbufferStorage(r.RENDERBUFFER,V,S.width,S.height)}}r.bindRenderbuffer(r.RENDERBUFFER,null)}function ye(R,S,C){let N=S.isWebGLCubeRenderTarget===!0;if(t.bindFramebuffer(r.FRAMEBUFFER,R),!S.depthTexture||!S.depthTexture.isDepthTexture)throw new Error("renderTarget.depthTexture must be an instance of THREE.DepthTexture");let x=i.get(S.depthTexture);if(x.__renderTarget=S,x.__webglTexture&&S.depthTexture.image.width===S.width&&S.depthTexture.image.height===S.height||(S.depthTexture.image.width=S.width,S.depthTexture.image.height=S.height,S.depthTexture.needsUpdate=!0),N){if(x.__webglInit===void 0&&(x.__webglInit=!0,S.depthTexture.addEventListener("dispose",D)),x.__webglTexture===void 0){x.__webglTexture=r.createTexture(),t.bindTexture(r.TEXTURE_CUBE_MAP,x.__webglTexture),k(r.TEXTURE_CUBE_MAP,S.depthTexture);let W=s.convert(S.depthTexture.format),$=s.convert(S.depthTexture.type),Q;S.depthTexture.format===on?Q=r.DEPTH_COMPONENT24:S.depthTexture.format===Rn&&(Q=r.DEPTH24_STENCIL8);for(let de=0;de<6;de++)r.texImage2D(r.TEXTURE_CUBE_MAP_POSITIVE_X+de,0,Q,S.width,S.height,0,W,$,null)}}else H(S.depthTexture,0);let L=x.__webglTexture,U=ie(S),T=N?r.TEXTURE_CUBE_MAP_POSITIVE_X+C:r.TEXTURE_2D,V=S.depthTexture.format===Rn?r.DEPTH_STENCIL_ATTACHMENT:r.DEPTH_ATTACHMENT;if(S.depthTexture.format===on)ve(S)?o.framebufferTexture2DMultisampleEXT(r.FRAMEBUFFER,V,T,L,0,U):r.framebufferTexture2D(r.FRAMEBUFFER,V,T,L,0);else{if(S.depthTexture.format!==Rn)throw new Error("Unknown depthTexture format");ve(S)?o.framebufferTexture2DMultisampleEXT(r.FRAMEBUFFER,V,T,L,0,U):r.framebufferTexture2D(r.FRAMEBUFFER,V,T,L,0)}}function xe(R){let S=i.get(R),C=R.isWebGLCubeRenderTarget===!0;if(S.__boundDepthTexture!==R.depthTexture){let N=R.depthTexture;if(S.__depthDisposeCallback&&S.__depthDisposeCallback(),N){let x=()=>{delete S.__boundDepthTexture,delete S.__depthDisposeCallback,N.removeEventListener("dispose",x)};N.addEventListener("dispose",x),S.__depthDisposeCallback=x}S.__boundDepthTexture=N}if(R.depthTexture&&!S.__autoAllocateDepthBuffer)if(C)for(let N=0;N<6;N++)ye(S.__webglFramebuffer[N],R,N);else{let N=R.texture.mipmaps;N&&N.length>0?ye(S.__webglFramebuffer[0],R,0):ye(S.__webglFramebuffer,R,0)}else if(C){S.__webglDepthbuffer=[];for(let N=0;N<6;N++)if(t.bindFramebuffer(r.FRAMEBUFFER,S.__webglFramebuffer[N]),S.__webglDepthbuffer[N]===void 0)S.__webglDepthbuffer[N]=r.createRenderbuffer(),be(S.__webglDepthbuffer[N],R,!1);else{let x=R.stencilBuffer?r.DEPTH_STENCIL_ATTACHMENT:r.DEPTH_ATTACHMENT,L=S.__webglDepthbuffer[N];r.bindRenderbuffer(r.RENDERBUFFER,L),r.framebufferRenderbuffer(r.FRAMEBUFFER,x,r.RENDERBUFFER,L)}}else{let N=R.texture.mipmaps;if(N&&N.length>0?t.bindFramebuffer(r.FRAMEBUFFER,S.__webglFramebuffer[0]):t.bindFramebuffer(r.FRAMEBUFFER,S.__webglFramebuffer),S.__webglDepthbuffer===void 0)S.__webglDepthbuffer=r.createRenderbuffer(),be(S.__webglDepthbuffer,R,!1);else{let x=R.stencilBuffer?r.DEPTH_STENCIL_ATTACHMENT:r.DEPTH_ATTACHMENT,L=S.__webglDepthbuffer;r.bindRenderbuffer(r.RENDERBUFFER,L),r.framebufferRenderbuffer(r.FRAMEBUFFER,x,r.RENDERBUFFER,L)}}t.bindFramebuffer(r.FRAMEBUFFER,null)}let ee=[],ae=[];function ie(R){return Math.min(n.maxSamples,R.samples)}function ve(R){let S=i.get(R);return R.samples>0&&e.has("WEBGL_multisampled_render_to_texture")===!0&&S.__useRenderToTexture!==!1}function ke(R,S){let C=R.colorSpace,N=R.format,x=R.type;return R.isCompressedTexture===!0||R.isVideoTexture===!0||C!==Br&&C!==Ri&&(Ve.getTransfer(C)===Ke?N===Jt&&x===zt||we("WebGLTextures: sRGB encoded textures have to use RGBAFormat and UnsignedByteType."):Te("WebGLTextures: Unsupported texture color space:",C)),S}function te(R){return typeof HTMLImageElement<"u"&&R instanceof HTMLImageElement?(c.width=R.naturalWidth||R.width,c.height=R.naturalHeight||R.height):typeof VideoFrame<"u"&&R instanceof VideoFrame?(c.width=R.displayWidth,c.height=R.displayHeight):(c.width=R.width,c.height=R.height),c}this.allocateTextureUnit=function(){let R=P;return R>=n.maxTextures&&we("WebGLTextures: Trying to use "+R+" texture units while this GPU supports only "+n.maxTextures),P+=1,R},this.resetTextureUnits=function(){P=0},this.getTextureUnits=function(){return P},this.setTextureUnits=function(R){P=R},this.setTexture2D=H,this.setTexture2DArray=function(R,S){let C=i.get(R);R.isRenderTargetTexture===!1&&R.version>0&&C.__version!==R.version?oe(C,R,S):(R.isExternalTexture&&(C.__webglTexture=R.sourceTexture?R.sourceTexture:null),t.bindTexture(r.TEXTURE_2D_ARRAY,C.__webglTexture,r.TEXTURE0+S))},this.setTexture3D=function(R,S){let C=i.get(R);R.isRenderTargetTexture===!1&&R.version>0&&C.__version!==R.version?oe(C,R,S):t.bindTexture(r.TEXTURE_3D,C.__webglTexture,r.TEXTURE0+S)},this.setTextureCube=function(R,S){let C=i.get(R);R.isCubeDepthTexture!==!0&&R.version>0&&C.__version!==R.version?(function(N,x,L){if(x.image.length!==6)return;let U=q(N,x),T=x.source;t.bindTexture(r.TEXTURE_CUBE_MAP,N.__webglTexture,r.TEXTURE0+L);let V=i.get(T);if(T.version!==V.__version||U===!0){t.activeTexture(r.TEXTURE0+L);let W=Ve.getPrimaries(Ve.workingColorSpace),$=x.colorSpace===Ri?null:Ve.getPrimaries(x.colorSpace),Q=x.colorSpace===Ri||W===$?r.NONE:r.BROWSER_DEFAULT_WEBGL;t.pixelStorei(r.UNPACK_FLIP_Y_WEBGL,x.flipY),t.pixelStorei(r.UNPACK_PREMULTIPLY_ALPHA_WEBGL,x.premultiplyAlpha),t.pixelStorei(r.UNPACK_ALIGNMENT,x.unpackAlignment),t.pixelStorei(r.UNPACK_COLORSPACE_CONVERSION_WEBGL,Q);let de=x.isCompressedTexture||x.image[0].isCompressedTexture,Z=x.image[0]&&x.image[0].isDataTexture,fe=[];for(let Se=0;Se<6;Se++)fe[Se]=de||Z?Z?x.image[Se].image:x.image[Se]:_(x.image[Se],!0,n.maxCubemapSize),fe[Se]=ke(x,fe[Se]);let ce=fe[0],pe=s.convert(x.format,x.colorSpace),se=s.convert(x.type),Me=w(x.internalFormat,pe,se,x.normalized,x.colorSpace),ze=x.isVideoTexture!==!0,nt=V.__version===void 0||U===!0,qe=T.dataReady,rt,Ft=M(x,ce);if(k(r.TEXTURE_CUBE_MAP,x),de){ze&&nt&&t.texStorage2D(r.TEXTURE_CUBE_MAP,Ft,Me,ce.width,ce.height);for(let Se=0;Se<6;Se++){rt=fe[Se].mipmaps;for(let Oe=0;Oe<rt.length;Oe++){let Ce=rt[Oe];x.format!==Jt?pe!==null?ze?qe&&t.compressedTexSubImage2D(r.TEXTURE_CUBE_MAP_POSITIVE_X+Se,Oe,0,0,Ce.width,Ce.height,pe,Ce.data):t.compressedTexImage2D(r.TEXTURE_CUBE_MAP_POSITIVE_X+Se,Oe,Me,Ce.width,Ce.height,0,Ce.data):we("WebGLRenderer: Attempt to load unsupported compressed texture format in .setTextureCube()"):ze?qe&&t.texSubImage2D(r.TEXTURE_CUBE_MAP_POSITIVE_X+Se,Oe,0,0,Ce.width,Ce.height,pe,se,Ce.data):t.texImage2D(r.TEXTURE_CUBE_MAP_POSITIVE_X+Se,Oe,Me,Ce.width,Ce.height,0,pe,se,Ce.data)}}}else{if(rt=x.mipmaps,ze&&nt){rt.length>0&&Ft++;let Se=te(fe[0]);t.texStorage2D(r.TEXTURE_CUBE_MAP,Ft,Me,Se.width,Se.height)}for(let Se=0;Se<6;Se++)if(Z){ze?qe&&t.texSubImage2D(r.TEXTURE_CUBE_MAP_POSITIVE_X+Se,0,0,0,fe[Se].width,fe[Se].height,pe,se,fe[Se].data):t.texImage2D(r.TEXTURE_CUBE_MAP_POSITIVE_X+Se,0,Me,fe[Se].width,fe[Se].height,0,pe,se,fe[Se].data);for(let Oe=0;Oe<rt.length;Oe++){let Ce=rt[Oe].image[Se].image;ze?qe&&t.texSubImage2D(r.TEXTURE_CUBE_MAP_POSITIVE_X+Se,Oe+1,0,0,Ce.width,Ce.height,pe,se,Ce.data):t.texImage2D(r.TEXTURE_CUBE_MAP_POSITIVE_X+Se,Oe+1,Me,Ce.width,Ce.height,0,pe,se,Ce.data)}}else{ze?qe&&t.texSubImage2D(r.TEXTURE_CUBE_MAP_POSITIVE_X+Se,0,0,0,pe,se,fe[Se]):t.texImage2D(r.TEXTURE_CUBE_MAP_POSITIVE_X+Se,0,Me,pe,se,fe[Se]);for(let Oe=0;Oe<rt.length;Oe++){let Ce=rt[Oe];ze?qe&&t.texSubImage2D(r.TEXTURE_CUBE_MAP_POSITIVE_X+Se,Oe+1,0,0,pe,se,Ce.image[Se]):t.texImage2D(r.TEXTURE_CUBE_MAP_POSITIVE_X+Se,Oe+1,Me,pe,se,Ce.image[Se])}}}m(x)&&v(r.TEXTURE_CUBE_MAP),V.__version=T.version,x.onUpdate&&x.onUpdate(x)}N.__version=x.version})(C,R,S):t.bindTexture(r.TEXTURE_CUBE_MAP,C.__webglTexture,r.TEXTURE0+S)},this.rebindTextures=function(R,S,C){let N=i.get(R);S!==void 0&&ue(N.__webglFramebuffer,R,R.texture,r.COLOR_ATTACHMENT0,r.TEXTURE_2D,0),C!==void 0&&xe(R)},this.setupRenderTarget=function(R){let S=R.texture,C=i.get(R),N=i.get(S);R.addEventListener("dispose",F);let x=R.textures,L=R.isWebGLCubeRenderTarget===!0,U=x.length>1;if(U||(N.__webglTexture===void 0&&(N.__webglTexture=r.createTexture()),N.__version=S.version,a.memory.textures++),L){C.__webglFramebuffer=[];for(let T=0;T<6;T++)if(S.mipmaps&&S.mipmaps.length>0){C.__webglFramebuffer[T]=[];for(let V=0;V<S.mipmaps.length;V++)C.__webglFramebuffer[T][V]=r.createFramebuffer()}else C.__webglFramebuffer[T]=r.createFramebuffer()}else{if(S.mipmaps&&S.mipmaps.length>0){C.__webglFramebuffer=[];for(let T=0;T<S.mipmaps.length;T++)C.__webglFramebuffer[T]=r.createFramebuffer()}else C.__webglFramebuffer=r.createFramebuffer();if(U)for(let T=0,V=x.length;T<V;T++){let W=i.get(x[T]);W.__webglTexture===void 0&&(W.__webglTexture=r.createTexture(),a.memory.textures++)}if(R.samples>0&&ve(R)===!1){C.__webglMultisampledFramebuffer=r.createFramebuffer(),C.__webglColorRenderbuffer=[],t.bindFramebuffer(r.FRAMEBUFFER,C.__webglMultisampledFramebuffer);for(let T=0;T<x.length;T++){let V=x[T];C.__webglColorRenderbuffer[T]=r.createRenderbuffer(),r.bindRenderbuffer(r.RENDERBUFFER,C.__webglColorRenderbuffer[T]);let W=s.convert(V.format,V.colorSpace),$=s.convert(V.type),Q=w(V.internalFormat,W,$,V.normalized,V.colorSpace,R.isXRRenderTarget===!0),de=ie(R);r.renderbufferStorageMultisample(r.RENDERBUFFER,de,Q,R.width,R.height),r.framebufferRenderbuffer(r.FRAMEBUFFER,r.COLOR_ATTACHMENT0+T,r.RENDERBUFFER,C.__webglColorRenderbuffer[T])}r.bindRenderbuffer(r.RENDERBUFFER,null),R.depthBuffer&&(C.__webglDepthRenderbuffer=r.createRenderbuffer(),be(C.__webglDepthRenderbuffer,R,!0)),t.bindFramebuffer(r.FRAMEBUFFER,null)}}if(L){t.bindTexture(r.TEXTURE_CUBE_MAP,N.__webglTexture),k(r.TEXTURE_CUBE_MAP,S);for(let T=0;T<6;T++)if(S.mipmaps&&S.mipmaps.length>0)for(let V=0;V<S.mipmaps.length;V++)ue(C.__webglFramebuffer[T][V],R,S,r.COLOR_ATTACHMENT0,r.TEXTURE_CUBE_MAP_POSITIVE_X+T,V);else ue(C.__webglFramebuffer[T],R,S,r.COLOR_ATTACHMENT0,r.TEXTURE_CUBE_MAP_POSITIVE_X+T,0);m(S)&&v(r.TEXTURE_CUBE_MAP),t.unbindTexture()}else if(U){for(let T=0,V=x.length;T<V;T++){let W=x[T],$=i.get(W),Q=r.TEXTURE_2D;(R.isWebGL3DRenderTarget||R.isWebGLArrayRenderTarget)&&(Q=R.isWebGL3DRenderTarget?r.TEXTURE_3D:r.TEXTURE_2D_ARRAY),t.bindTexture(Q,$.__webglTexture),k(Q,W),ue(C.__webglFramebuffer,R,W,r.COLOR_ATTACHMENT0+T,Q,0),m(W)&&v(Q)}t.unbindTexture()}else{let T=r.TEXTURE_2D;if((R.isWebGL3DRenderTarget||R.isWebGLArrayRenderTarget)&&(T=R.isWebGL3DRenderTarget?r.TEXTURE_3D:r.TEXTURE_2D_ARRAY),t.bindTexture(T,N.__webglTexture),k(T,S),S.mipmaps&&S.mipmaps.length>0)for(let V=0;V<S.mipmaps.length;V++)ue(C.__webglFramebuffer[V],R,S,r.COLOR_ATTACHMENT0,T,V);else ue(C.__webglFramebuffer,R,S,r.COLOR_ATTACHMENT0,T,0);m(S)&&v(T),t.unbindTexture()}R.depthBuffer&&xe(R)},this.updateRenderTargetMipmap=function(R){let S=R.textures;for(let C=0,N=S.length;C<N;C++){let x=S[C];if(m(x)){let L=y(R),U=i.get(x).__webglTexture;t.bindTexture(L,U),v(L),t.unbindTexture()}}},this.updateMultisampleRenderTarget=function(R){if(R.samples>0){if(ve(R)===!1){let S=R.textures,C=R.width,N=R.height,x=r.COLOR_BUFFER_BIT,L=R.stencilBuffer?r.DEPTH_STENCIL_ATTACHMENT:r.DEPTH_ATTACHMENT,U=i.get(R),T=S.length>1;if(T)for(let W=0;W<S.length;W++)t.bindFramebuffer(r.FRAMEBUFFER,U.__webglMultisampledFramebuffer),r.framebufferRenderbuffer(r.FRAMEBUFFER,r.COLOR_ATTACHMENT0+W,r.RENDERBUFFER,null),t.bindFramebuffer(r.FRAMEBUFFER,U.__webglFramebuffer),r.framebufferTexture2D(r.DRAW_FRAMEBUFFER,r.COLOR_ATTACHMENT0+W,r.TEXTURE_2D,null,0);t.bindFramebuffer(r.READ_FRAMEBUFFER,U.__webglMultisampledFramebuffer);let V=R.texture.mipmaps;V&&V.length>0?t.bindFramebuffer(r.DRAW_FRAMEBUFFER,U.__webglFramebuffer[0]):t.bindFramebuffer(r.DRAW_FRAMEBUFFER,U.__webglFramebuffer);for(let W=0;W<S.length;W++){if(R.resolveDepthBuffer&&(R.depthBuffer&&(x|=r.DEPTH_BUFFER_BIT),R.stencilBuffer&&R.resolveStencilBuffer&&(x|=r.STENCIL_BUFFER_BIT)),T){r.framebufferRenderbuffer(r.READ_FRAMEBUFFER,r.COLOR_ATTACHMENT0,r.RENDERBUFFER,U.__webglColorRenderbuffer[W]);let $=i.get(S[W]).__webglTexture;r.framebufferTexture2D(r.DRAW_FRAMEBUFFER,r.COLOR_ATTACHMENT0,r.TEXTURE_2D,$,0)}r.blitFramebuffer(0,0,C,N,0,0,C,N,x,r.NEAREST),l===!0&&(ee.length=0,ae.length=0,ee.push(r.COLOR_ATTACHMENT0+W),R.depthBuffer&&R.resolveDepthBuffer===!1&&(ee.push(L),ae.push(L),r.invalidateFramebuffer(r.DRAW_FRAMEBUFFER,ae)),r.invalidateFramebuffer(r.READ_FRAMEBUFFER,ee))}if(t.bindFramebuffer(r.READ_FRAMEBUFFER,null),t.bindFramebuffer(r.DRAW_FRAMEBUFFER,null),T)for(let W=0;W<S.length;W++){t.bindFramebuffer(r.FRAMEBUFFER,U.__webglMultisampledFramebuffer),r.framebufferRenderbuffer(r.FRAMEBUFFER,r.COLOR_ATTACHMENT0+W,r.RENDERBUFFER,U.__webglColorRenderbuffer[W]);let $=i.get(S[W]).__webglTexture;t.bindFramebuffer(r.FRAMEBUFFER,U.__webglFramebuffer),r.framebufferTexture2D(r.DRAW_FRAMEBUFFER,r.COLOR_ATTACHMENT0+W,r.TEXTURE_2D,$,0)}t.bindFramebuffer(r.DRAW_FRAMEBUFFER,U.__webglMultisampledFramebuffer)}else if(R.depthBuffer&&R.resolveDepthBuffer===!1&&l){let S=R.stencilBuffer?r.DEPTH_STENCIL_ATTACHMENT:r.DEPTH_ATTACHMENT;r.invalidateFramebuffer(r.DRAW_FRAMEBUFFER,[S])}}},this.setupDepthRenderbuffer=xe,this.setupFrameBufferTexture=ue,this.useMultisampledRTT=ve,this.isReversedDepthBuffer=function(){return t.buffers.depth.getReversed()}}function U0(r,e){return{convert:function(t,i=Ri){let n,s=Ve.getTransfer(i);if(t===zt)return r.UNSIGNED_BYTE;if(t===fo)return r.UNSIGNED_SHORT_4_4_4_4;if(t===mo)return r.UNSIGNED_SHORT_5_5_5_1;if(t===xc)return r.UNSIGNED_INT_5_9_9_9_REV;if(t===yc)return r.UNSIGNED_INT_10F_11F_11F_REV;if(t===vc)return r.BYTE;if(t===_c)return r.SHORT;if(t===an)return r.UNSIGNED_SHORT;if(t===po)return r.INT;if(t===Vi)return r.UNSIGNED_INT;if(t===gi)return r.FLOAT;if(t===Ci)return r.HALF_FLOAT;if(t===Dd)return r.ALPHA;if(t===Nd)return r.RGB;if(t===Jt)return r.RGBA;if(t===on)return r.DEPTH_COMPONENT;if(t===Rn)return r.DEPTH_STENCIL;if(t===Mc)return r.RED;if(t===In)return r.RED_INTEGER;if(t===Pn)return r.RG;if(t===Sc)return r.RG_INTEGER;if(t===bc)return r.RGBA_INTEGER;if(t===go||t===vo||t===_o||t===xo)if(s===Ke){if(n=e.get("WEBGL_compressed_texture_s3tc_srgb"),n===null)return null;if(t===go)return n.COMPRESSED_SRGB_S3TC_DXT1_EXT;if(t===vo)return n.COMPRESSED_SRGB_ALPHA_S3TC_DXT1_EXT;if(t===_o)return n.COMPRESSED_SRGB_ALPHA_S3TC_DXT3_EXT;if(t===xo)return n.COMPRESSED_SRGB_ALPHA_S3TC_DXT5_EXT}else{if(n=e.get("WEBGL_compressed_texture_s3tc"),n===null)return null;if(t===go)return n.COMPRESSED_RGB_S3TC_DXT1_EXT;if(t===vo)return n.COMPRESSED_RGBA_S3TC_DXT1_EXT;if(t===_o)return n.COMPRESSED_RGBA_S3TC_DXT3_EXT;if(t===xo)return n.COMPRESSED_RGBA_S3TC_DXT5_EXT}if(t===wc||t===Tc||t===Ec||t===Ac){if(n=e.get("WEBGL_compressed_texture_pvrtc"),n===null)return null;if(t===wc)return n.COMPRESSED_RGB_PVRTC_4BPPV1_IMG;if(t===Tc)return n.COMPRESSED_RGB_PVRTC_2BPPV1_IMG;if(t===Ec)return n.COMPRESSED_RGBA_PVRTC_4BPPV1_IMG;if(t===Ac)return n.COMPRESSED_RGBA_PVRTC_2BPPV1_IMG}if(t===Cc||t===Rc||t===Ic||t===Pc||t===Lc||t===yo||t===Uc){if(n=e.get("WEBGL_compressed_texture_etc"),n===null)return null;if(t===Cc||t===Rc)return s===Ke?n.COMPRESSED_SRGB8_ETC2:n.COMPRESSED_RGB8_ETC2;if(t===Ic)return s===Ke?n.COMPRESSED_SRGB8_ALPHA8_ETC2_EAC:n.COMPRESSED_RGBA8_ETC2_EAC;if(t===Pc)return n.COMPRESSED_R11_EAC;if(t===Lc)return n.COMPRESSED_SIGNED_R11_EAC;if(t===yo)return n.COMPRESSED_RG11_EAC;if(t===Uc)return n.COMPRESSED_SIGNED_RG11_EAC}if(t===Dc||t===Nc||t===Fc||t===Oc||t===Bc||t===kc||t===zc||t===Gc||t===Vc||t===Hc||t===Wc||t===Xc||t===jc||t===qc){if(n=e.get("WEBGL_compressed_texture_astc"),n===null)return null;if(t===Dc)return s===Ke?n.COMPRESSED_SRGB8_ALPHA8_ASTC_4x4_KHR:n.COMPRESSED_RGBA_ASTC_4x4_KHR;if(t===Nc)return s===Ke?n.COMPRESSED_SRGB8_ALPHA8_ASTC_5x4_KHR:n.COMPRESSED_RGBA_ASTC_5x4_KHR;if(t===Fc)return s===Ke?n.COMPRESSED_SRGB8_ALPHA8_ASTC_5x5_KHR:n.COMPRESSED_RGBA_ASTC_5x5_KHR;if(t===Oc)return s===Ke?n.COMPRESSED_SRGB8_ALPHA8_ASTC_6x5_KHR:n.COMPRESSED_RGBA_ASTC_6x5_KHR;if(t===Bc)return s===Ke?n.COMPRESSED_SRGB8_ALPHA8_ASTC_6x6_KHR:n.COMPRESSED_RGBA_ASTC_6x6_KHR;if(t===kc)return s===Ke?n.COMPRESSED_SRGB8_ALPHA8_ASTC_8x5_KHR:n.COMPRESSED_RGBA_ASTC_8x5_KHR;if(t===zc)return s===Ke?n.COMPRESSED_SRGB8_ALPHA8_ASTC_8x6_KHR:n.COMPRESSED_RGBA_ASTC_8x6_KHR;if(t===Gc)return s===Ke?n.COMPRESSED_SRGB8_ALPHA8_ASTC_8x8_KHR:n.COMPRESSED_RGBA_ASTC_8x8_KHR;if(t===Vc)return s===Ke?n.COMPRESSED_SRGB8_ALPHA8_ASTC_10x5_KHR:n.COMPRESSED_RGBA_ASTC_10x5_KHR;if(t===Hc)return s===Ke?n.COMPRESSED_SRGB8_ALPHA8_ASTC_10x6_KHR:n.COMPRESSED_RGBA_ASTC_10x6_KHR;if(t===Wc)return s===Ke?n.COMPRESSED_SRGB8_ALPHA8_ASTC_10x8_KHR:n.COMPRESSED_RGBA_ASTC_10x8_KHR;if(t===Xc)return s===Ke?n.COMPRESSED_SRGB8_ALPHA8_ASTC_10x10_KHR:n.COMPRESSED_RGBA_ASTC_10x10_KHR;if(t===jc)return s===Ke?n.COMPRESSED_SRGB8_ALPHA8_ASTC_12x10_KHR:n.COMPRESSED_RGBA_ASTC_12x10_KHR;if(t===qc)return s===Ke?n.COMPRESSED_SRGB8_ALPHA8_ASTC_12x12_KHR:n.COMPRESSED_RGBA_ASTC_12x12_KHR}if(t===Yc||t===Zc||t===Kc){if(n=e.get("EXT_texture_compression_bptc"),n===null)return null;if(t===Yc)return s===Ke?n.COMPRESSED_SRGB_ALPHA_BPTC_UNORM_EXT:n.COMPRESSED_RGBA_BPTC_UNORM_EXT;if(t===Zc)return n.COMPRESSED_RGB_BPTC_SIGNED_FLOAT_EXT;if(t===Kc)return n.COMPRESSED_RGB_BPTC_UNSIGNED_FLOAT_EXT}if(t===$c||t===Jc||t===Mo||t===Qc){if(n=e.get("EXT_texture_compression_rgtc"),n===null)return null;if(t===$c)return n.COMPRESSED_RED_RGTC1_EXT;if(t===Jc)return n.COMPRESSED_SIGNED_RED_RGTC1_EXT;if(t===Mo)return n.COMPRESSED_RED_GREEN_RGTC2_EXT;if(t===Qc)return n.COMPRESSED_SIGNED_RED_GREEN_RGTC2_EXT}return t===mr?r.UNSIGNED_INT_24_8:r[t]!==void 0?r[t]:null}}}var xh=class{constructor(){this.texture=null,this.mesh=null,this.depthNear=0,this.depthFar=0}init(e,t){if(this.texture===null){let i=new Yr(e.texture);e.depthNear===t.depthNear&&e.depthFar===t.depthFar||(this.depthNear=e.depthNear,this.depthFar=e.depthFar),this.texture=i}}getMesh(e){if(this.texture!==null&&this.mesh===null){let t=e.cameras[0].viewport,i=new $t({vertexShader:`
void main() {

	gl_Position = vec4( position, 1.0 );

}`,fragmentShader:`
uniform sampler2DArray depthColor;
uniform float depthWidth;
uniform float depthHeight;

void main() {

	vec2 coord = vec2( gl_FragCoord.x / depthWidth, gl_FragCoord.y / depthHeight );

	if ( coord.x >= 1.0 ) {

		gl_FragDepth = texture( depthColor, vec3( coord.x - 1.0, coord.y, 1 ) ).r;

	} else {

		gl_FragDepth = texture( depthColor, vec3( coord.x, coord.y, 0 ) ).r;

	}

}`,uniforms:{depthColor:{value:this.texture},depthWidth:{value:t.z},depthHeight:{value:t.w}}});this.mesh=new Ct(new cr(20,20),i)}return this.mesh}reset(){this.texture=null,this.mesh=null}getDepthTexture(){return this.texture}},yh=class extends Ei{constructor(e,t){super();let i=this,n=null,s=1,a=null,o="local-floor",l=1,c=null,h=null,u=null,f=null,p=null,g=null,d=typeof XRWebGLBinding<"u",_=new xh,m={},v=t.getContextAttributes(),y=null,w=null,E=[],M=[],D=new ne,F=null,I=new Ht;I.viewport=new $e;let P=new Ht;P.viewport=new $e;let H=[I,P],O=new oo,j=null,z=null;function k(ee){let ae=M.indexOf(ee.inputSource);if(ae===-1)return;let ie=E[ae];ie!==void 0&&(ie.update(ee.inputSource,ee.frame,c||a),ie.dispatchEvent({type:ee.type,data:ee.inputSource}))}function q(){n.removeEventListener("select",k),n.removeEventListener("selectstart",k),n.removeEventListener("selectend",k),n.removeEventListener("squeeze",k),n.removeEventListener("squeezestart",k),n.removeEventListener("squeezeend",k),n.removeEventListener("end",q),n.removeEventListener("inputsourceschange",X);for(let ee=0;ee<E.length;ee++){let ae=M[ee];ae!==null&&(M[ee]=null,E[ee].disconnect(ae))}j=null,z=null,_.reset();for(let ee in m)delete m[ee];e.setRenderTarget(y),p=null,f=null,u=null,n=null,w=null,xe.stop(),i.isPresenting=!1,e.setPixelRatio(F),e.setSize(D.width,D.height,!1),i.dispatchEvent({type:"sessionend"})}function X(ee){for(let ae=0;ae<ee.removed.length;ae++){let ie=ee.removed[ae],ve=M.indexOf(ie);ve>=0&&(M[ve]=null,E[ve].disconnect(ie))}for(let ae=0;ae<ee.added.length;ae++){let ie=ee.added[ae],ve=M.indexOf(ie);if(ve===-1){for(let te=0;te<E.length;te++){if(te>=M.length){M.push(ie),ve=te;break}if(M[te]===null){M[te]=ie,ve=te;break}}if(ve===-1)break}let ke=E[ve];ke&&ke.connect(ie)}}this.cameraAutoUpdate=!0,this.enabled=!1,this.isPresenting=!1,this.getController=function(ee){let ae=E[ee];return ae===void 0&&(ae=new sr,E[ee]=ae),ae.getTargetRaySpace()},this.getControllerGrip=function(ee){let ae=E[ee];return ae===void 0&&(ae=new sr,E[ee]=ae),ae.getGripSpace()},this.getHand=function(ee){let ae=E[ee];return ae===void 0&&(ae=new sr,E[ee]=ae),ae.getHandSpace()},this.setFramebufferScaleFactor=function(ee){s=ee,i.isPresenting===!0&&we("WebXRManager: Cannot change framebuffer scale while presenting.")},this.setReferenceSpaceType=function(ee){o=ee,i.isPresenting===!0&&we("WebXRManager: Cannot change reference space type while presenting.")},this.getReferenceSpace=function(){return c||a},this.setReferenceSpace=function(ee){c=ee},this.getBaseLayer=function(){return f!==null?f:p},this.getBinding=function(){return u===null&&d&&(u=new XRWebGLBinding(n,t)),u},this.getFrame=function(){return g},this.getSession=function(){return n},this.setSession=async function(ee){if(n=ee,n!==null){if(y=e.getRenderTarget(),n.addEventListener("select",k),n.addEventListener("selectstart",k),n.addEventListener("selectend",k),n.addEventListener("squeeze",k),n.addEventListener("squeezestart",k),n.addEventListener("squeezeend",k),n.addEventListener("end",q),n.addEventListener("inputsourceschange",X),v.xrCompatible!==!0&&await t.makeXRCompatible(),F=e.getPixelRatio(),e.getSize(D),d&&"createProjectionLayer"in XRWebGLBinding.prototype){let ae=null,ie=null,ve=null;v.depth&&(ve=v.stencil?t.DEPTH24_STENCIL8:t.DEPTH_COMPONENT24,ae=v.stencil?Rn:on,ie=v.stencil?mr:Vi);let ke={colorFormat:t.RGBA8,depthFormat:ve,scaleFactor:s};u=this.getBinding(),f=u.createProjectionLayer(ke),n.updateRenderState({layers:[f]}),e.setPixelRatio(1),e.setSize(f.textureWidth,f.textureHeight,!1),w=new kt(f.textureWidth,f.textureHeight,{format:Jt,type:zt,depthTexture:new Gi(f.textureWidth,f.textureHeight,ie,void 0,void 0,void 0,void 0,void 0,void 0,ae),stencilBuffer:v.stencil,colorSpace:e.outputColorSpace,samples:v.antialias?4:0,resolveDepthBuffer:f.ignoreDepthValues===!1,resolveStencilBuffer:f.ignoreDepthValues===!1})}else{let ae={antialias:v.antialias,alpha:!0,depth:v.depth,stencil:v.stencil,framebufferScaleFactor:s};p=new XRWebGLLayer(n,t,ae),n.updateRenderState({baseLayer:p}),e.setPixelRatio(1),e.setSize(p.framebufferWidth,p.framebufferHeight,!1),w=new kt(p.framebufferWidth,p.framebufferHeight,{format:Jt,type:zt,colorSpace:e.outputColorSpace,stencilBuffer:v.stencil,resolveDepthBuffer:p.ignoreDepthValues===!1,resolveStencilBuffer:p.ignoreDepthValues===!1})}w.isXRRenderTarget=!0,this.setFoveation(l),c=null,a=await n.requestReferenceSpace(o),xe.setContext(n),xe.start(),i.isPresenting=!0,i.dispatchEvent({type:"sessionstart"})}},this.getEnvironmentBlendMode=function(){if(n!==null)return n.environmentBlendMode},this.getDepthTexture=function(){return _.getDepthTexture()};let oe=new A,ue=new A;function be(ee,ae){ae===null?ee.matrixWorld.copy(ee.matrix):ee.matrixWorld.multiplyMatrices(ae.matrixWorld,ee.matrix),ee.matrixWorldInverse.copy(ee.matrixWorld).invert()}this.updateCamera=function(ee){if(n===null)return;let ae=ee.near,ie=ee.far;_.texture!==null&&(_.depthNear>0&&(ae=_.depthNear),_.depthFar>0&&(ie=_.depthFar)),O.near=P.near=I.near=ae,O.far=P.far=I.far=ie,j===O.near&&z===O.far||(n.updateRenderState({depthNear:O.near,depthFar:O.far}),j=O.near,z=O.far),O.layers.mask=6|ee.layers.mask,I.layers.mask=-5&O.layers.mask,P.layers.mask=-3&O.layers.mask;let ve=ee.parent,ke=O.cameras;be(O,ve);for(let te=0;te<ke.length;te++)be(ke[te],ve);ke.length===2?(function(te,R,S){oe.setFromMatrixPosition(R.matrixWorld),ue.setFromMatrixPosition(S.matrixWorld);let C=oe.distanceTo(ue),N=R.projectionMatrix.elements,x=S.projectionMatrix.elements,L=N[14]/(N[10]-1),U=N[14]/(N[10]+1),T=(N[9]+1)/N[5],V=(N[9]-1)/N[5],W=(N[8]-1)/N[0],$=(x[8]+1)/x[0],Q=L*W,de=L*$,Z=C/(-W+$),fe=Z*-W;if(R.matrixWorld.decompose(te.position,te.quaternion,te.scale),te.translateX(fe),te.translateZ(Z),te.matrixWorld.compose(te.position,te.quaternion,te.scale),te.matrixWorldInverse.copy(te.matrixWorld).invert(),N[10]===-1)te.projectionMatrix.copy(R.projectionMatrix),te.projectionMatrixInverse.copy(R.projectionMatrixInverse);else{let ce=L+Z,pe=U+Z,se=Q-fe,Me=de+(C-fe),ze=T*U/pe*ce,nt=V*U/pe*ce;te.projectionMatrix.makePerspective(se,Me,ze,nt,ce,pe),te.projectionMatrixInverse.copy(te.projectionMatrix).invert()}})(O,I,P):O.projectionMatrix.copy(I.projectionMatrix),(function(te,R,S){S===null?te.matrix.copy(R.matrixWorld):(te.matrix.copy(S.matrixWorld),te.matrix.invert(),te.matrix.multiply(R.matrixWorld)),te.matrix.decompose(te.position,te.quaternion,te.scale),te.updateMatrixWorld(!0),te.projectionMatrix.copy(R.projectionMatrix),te.projectionMatrixInverse.copy(R.projectionMatrixInverse),te.isPerspectiveCamera&&(te.fov=2*xa*Math.atan(1/te.projectionMatrix.elements[5]),te.zoom=1)})(ee,O,ve)},this.getCamera=function(){return O},this.getFoveation=function(){if(f!==null||p!==null)return l},this.setFoveation=function(ee){l=ee,f!==null&&(f.fixedFoveation=ee),p!==null&&p.fixedFoveation!==void 0&&(p.fixedFoveation=ee)},this.hasDepthSensing=function(){return _.texture!==null},this.getDepthSensingMesh=function(){return _.getMesh(O)},this.getCameraTexture=function(ee){return m[ee]};let ye=null,xe=new Mp;xe.setAnimationLoop(function(ee,ae){if(h=ae.getViewerPose(c||a),g=ae,h!==null){let ie=h.views;p!==null&&(e.setRenderTargetFramebuffer(w,p.framebuffer),e.setRenderTarget(w));let ve=!1;ie.length!==O.cameras.length&&(O.cameras.length=0,ve=!0);for(let te=0;te<ie.length;te++){let R=ie[te],S=null;if(p!==null)S=p.getViewport(R);else{let N=u.getViewSubImage(f,R);S=N.viewport,te===0&&(e.setRenderTargetTextures(w,N.colorTexture,N.depthStencilTexture),e.setRenderTarget(w))}let C=H[te];C===void 0&&(C=new Ht,C.layers.enable(te),C.viewport=new $e,H[te]=C),C.matrix.fromArray(R.transform.matrix),C.matrix.decompose(C.position,C.quaternion,C.scale),C.projectionMatrix.fromArray(R.projectionMatrix),C.projectionMatrixInverse.copy(C.projectionMatrix).invert(),C.viewport.set(S.x,S.y,S.width,S.height),te===0&&(O.matrix.copy(C.matrix),O.matrix.decompose(O.position,O.quaternion,O.scale)),ve===!0&&O.cameras.push(C)}let ke=n.enabledFeatures;if(ke&&ke.includes("depth-sensing")&&n.depthUsage=="gpu-optimized"&&d){u=i.getBinding();let te=u.getDepthInformation(ie[0]);te&&te.isValid&&te.texture&&_.init(te,n.renderState)}if(ke&&ke.includes("camera-access")&&d){e.state.unbindTexture(),u=i.getBinding();for(let te=0;te<ie.length;te++){let R=ie[te].camera;if(R){let S=m[R];S||(S=new Yr,m[R]=S);let C=u.getCameraImage(R);S.sourceTexture=C}}}}for(let ie=0;ie<E.length;ie++){let ve=M[ie],ke=E[ie];ve!==null&&ke!==void 0&&ke.update(ve,ae,c||a)}ye&&ye(ee,ae),ae.detectedPlanes&&i.dispatchEvent({type:"planesdetected",data:ae}),g=null}),this.setAnimationLoop=function(ee){ye=ee},this.dispose=function(){}}},D0=new De,Ap=new Ue;function N0(r,e){function t(n,s){n.matrixAutoUpdate===!0&&n.updateMatrix(),s.value.copy(n.matrix)}function i(n,s){n.opacity.value=s.opacity,s.color&&n.diffuse.value.copy(s.color),s.emissive&&n.emissive.value.copy(s.emissive).multiplyScalar(s.emissiveIntensity),s.map&&(n.map.value=s.map,t(s.map,n.mapTransform)),s.alphaMap&&(n.alphaMap.value=s.alphaMap,t(s.alphaMap,n.alphaMapTransform)),s.bumpMap&&(n.bumpMap.value=s.bumpMap,t(s.bumpMap,n.bumpMapTransform),n.bumpScale.value=s.bumpScale,s.side===Wt&&(n.bumpScale.value*=-1)),s.normalMap&&(n.normalMap.value=s.normalMap,t(s.normalMap,n.normalMapTransform),n.normalScale.value.copy(s.normalScale),s.side===Wt&&n.normalScale.value.negate()),s.displacementMap&&(n.displacementMap.value=s.displacementMap,t(s.displacementMap,n.displacementMapTransform),n.displacementScale.value=s.displacementScale,n.displacementBias.value=s.displacementBias),s.emissiveMap&&(n.emissiveMap.value=s.emissiveMap,t(s.emissiveMap,n.emissiveMapTransform)),s.specularMap&&(n.specularMap.value=s.specularMap,t(s.specularMap,n.specularMapTransform)),s.alphaTest>0&&(n.alphaTest.value=s.alphaTest);let a=e.get(s),o=a.envMap,l=a.envMapRotation;o&&(n.envMap.value=o,n.envMapRotation.value.setFromMatrix4(D0.makeRotationFromEuler(l)).transpose(),o.isCubeTexture&&o.isRenderTargetTexture===!1&&n.envMapRotation.value.premultiply(Ap),n.reflectivity.value=s.reflectivity,n.ior.value=s.ior,n.refractionRatio.value=s.refractionRatio),s.lightMap&&(n.lightMap.value=s.lightMap,n.lightMapIntensity.value=s.lightMapIntensity,t(s.lightMap,n.lightMapTransform)),s.aoMap&&(n.aoMap.value=s.aoMap,n.aoMapIntensity.value=s.aoMapIntensity,t(s.aoMap,n.aoMapTransform))}return{refreshFogUniforms:function(n,s){s.color.getRGB(n.fogColor.value,nh(r)),s.isFog?(n.fogNear.value=s.near,n.fogFar.value=s.far):s.isFogExp2&&(n.fogDensity.value=s.density)},refreshMaterialUniforms:function(n,s,a,o,l){s.isNodeMaterial?s.uniformsNeedUpdate=!1:s.isMeshBasicMaterial?i(n,s):s.isMeshLambertMaterial?(i(n,s),s.envMap&&(n.envMapIntensity.value=s.envMapIntensity)):s.isMeshToonMaterial?(i(n,s),(function(c,h){h.gradientMap&&(c.gradientMap.value=h.gradientMap)})(n,s)):s.isMeshPhongMaterial?(i(n,s),(function(c,h){c.specular.value.copy(h.specular),c.shininess.value=Math.max(h.shininess,1e-4)})(n,s),s.envMap&&(n.envMapIntensity.value=s.envMapIntensity)):s.isMeshStandardMaterial?(i(n,s),(function(c,h){c.metalness.value=h.metalness,h.metalnessMap&&(c.metalnessMap.value=h.metalnessMap,t(h.metalnessMap,c.metalnessMapTransform)),c.roughness.value=h.roughness,h.roughnessMap&&(c.roughnessMap.value=h.roughnessMap,t(h.roughnessMap,c.roughnessMapTransform)),h.envMap&&(c.envMapIntensity.value=h.envMapIntensity)})(n,s),s.isMeshPhysicalMaterial&&(function(c,h,u){c.ior.value=h.ior,h.sheen>0&&(c.sheenColor.value.copy(h.sheenColor).multiplyScalar(h.sheen),c.sheenRoughness.value=h.sheenRoughness,h.sheenColorMap&&(c.sheenColorMap.value=h.sheenColorMap,t(h.sheenColorMap,c.sheenColorMapTransform)),h.sheenRoughnessMap&&(c.sheenRoughnessMap.value=h.sheenRoughnessMap,t(h.sheenRoughnessMap,c.sheenRoughnessMapTransform))),h.clearcoat>0&&(c.clearcoat.value=h.clearcoat,c.clearcoatRoughness.value=h.clearcoatRoughness,h.clearcoatMap&&(c.clearcoatMap.value=h.clearcoatMap,t(h.clearcoatMap,c.clearcoatMapTransform)),h.clearcoatRoughnessMap&&(c.clearcoatRoughnessMap.value=h.clearcoatRoughnessMap,t(h.clearcoatRoughnessMap,c.clearcoatRoughnessMapTransform)),h.clearcoatNormalMap&&(c.clearcoatNormalMap.value=h.clearcoatNormalMap,t(h.clearcoatNormalMap,c.clearcoatNormalMapTransform),c.clearcoatNormalScale.value.copy(h.clearcoatNormalScale),h.side===Wt&&c.clearcoatNormalScale.value.negate())),h.dispersion>0&&(c.dispersion.value=h.dispersion),h.iridescence>0&&(c.iridescence.value=h.iridescence,c.iridescenceIOR.value=h.iridescenceIOR,c.iridescenceThicknessMinimum.value=h.iridescenceThicknessRange[0],c.iridescenceThicknessMaximum.value=h.iridescenceThicknessRange[1],h.iridescenceMap&&(c.iridescenceMap.value=h.iridescenceMap,t(h.iridescenceMap,c.iridescenceMapTransform)),h.iridescenceThicknessMap&&(c.iridescenceThicknessMap.value=h.iridescenceThicknessMap,t(h.iridescenceThicknessMap,c.iridescenceThicknessMapTransform))),h.transmission>0&&(c.transmission.value=h.transmission,c.transmissionSamplerMap.value=u.texture,c.transmissionSamplerSize.value.set(u.width,u.height),h.transmissionMap&&(c.transmissionMap.value=h.transmissionMap,t(h.transmissionMap,c.transmissionMapTransform)),c.thickness.value=h.thickness,h.thicknessMap&&(c.thicknessMap.value=h.thicknessMap,t(h.thicknessMap,c.thicknessMapTransform)),c.attenuationDistance.value=h.attenuationDistance,c.attenuationColor.value.copy(h.attenuationColor)),h.anisotropy>0&&(c.anisotropyVector.value.set(h.anisotropy*Math.cos(h.anisotropyRotation),h.anisotropy*Math.sin(h.anisotropyRotation)),h.anisotropyMap&&(c.anisotropyMap.value=h.anisotropyMap,t(h.anisotropyMap,c.anisotropyMapTransform))),c.specularIntensity.value=h.specularIntensity,c.specularColor.value.copy(h.specularColor),h.specularColorMap&&(c.specularColorMap.value=h.specularColorMap,t(h.specularColorMap,c.specularColorMapTransform)),h.specularIntensityMap&&(c.specularIntensityMap.value=h.specularIntensityMap,t(h.specularIntensityMap,c.specularIntensityMapTransform))})(n,s,l)):s.isMeshMatcapMaterial?(i(n,s),(function(c,h){h.matcap&&(c.matcap.value=h.matcap)})(n,s)):s.isMeshDepthMaterial?i(n,s):s.isMeshDistanceMaterial?(i(n,s),(function(c,h){let u=e.get(h).light;c.referencePosition.value.setFromMatrixPosition(u.matrixWorld),c.nearDistance.value=u.shadow.camera.near,c.farDistance.value=u.shadow.camera.far})(n,s)):s.isMeshNormalMaterial?i(n,s):s.isLineBasicMaterial?((function(c,h){c.diffuse.value.copy(h.color),c.opacity.value=h.opacity,h.map&&(c.map.value=h.map,t(h.map,c.mapTransform))})(n,s),s.isLineDashedMaterial&&(function(c,h){c.dashSize.value=h.dashSize,c.totalSize.value=h.dashSize+h.gapSize,c.scale.value=h.scale})(n,s)):s.isPointsMaterial?(function(c,h,u,f){c.diffuse.value.copy(h.color),c.opacity.value=h.opacity,c.size.value=h.size*u,c.scale.value=.5*f,h.map&&(c.map.value=h.map,t(h.map,c.uvTransform)),h.alphaMap&&(c.alphaMap.value=h.alphaMap,t(h.alphaMap,c.alphaMapTransform)),h.alphaTest>0&&(c.alphaTest.value=h.alphaTest)})(n,s,a,o):s.isSpriteMaterial?(function(c,h){c.diffuse.value.copy(h.color),c.opacity.value=h.opacity,c.rotation.value=h.rotation,h.map&&(c.map.value=h.map,t(h.map,c.mapTransform)),h.alphaMap&&(c.alphaMap.value=h.alphaMap,t(h.alphaMap,c.alphaMapTransform)),h.alphaTest>0&&(c.alphaTest.value=h.alphaTest)})(n,s):s.isShadowMaterial?(n.color.value.copy(s.color),n.opacity.value=s.opacity):s.isShaderMaterial&&(s.uniformsNeedUpdate=!1)}}}function F0(r,e,t,i){let n={},s={},a=[],o=r.getParameter(r.MAX_UNIFORM_BUFFER_BINDINGS);function l(u,f,p,g){let d=u.value,_=f+"_"+p;if(g[_]===void 0)return typeof d=="number"||typeof d=="boolean"?g[_]=d:ArrayBuffer.isView(d)?g[_]=d.slice():g[_]=d.clone(),!0;{let m=g[_];if(typeof d=="number"||typeof d=="boolean"){if(m!==d)return g[_]=d,!0}else{if(ArrayBuffer.isView(d))return!0;if(m.equals(d)===!1)return m.copy(d),!0}}return!1}function c(u){let f={boundary:0,storage:0};return typeof u=="number"||typeof u=="boolean"?(f.boundary=4,f.storage=4):u.isVector2?(f.boundary=8,f.storage=8):u.isVector3||u.isColor?(f.boundary=16,f.storage=12):u.isVector4?(f.boundary=16,f.storage=16):u.isMatrix3?(f.boundary=48,f.storage=48):u.isMatrix4?(f.boundary=64,f.storage=64):u.isTexture?we("WebGLRenderer: Texture samplers can not be part of an uniforms group."):ArrayBuffer.isView(u)?(f.boundary=16,f.storage=u.byteLength):we("WebGLRenderer: Unsupported uniform value type.",u),f}function h(u){let f=u.target;f.removeEventListener("dispose",h);let p=a.indexOf(f.__bindingPointIndex);a.splice(p,1),r.deleteBuffer(n[f.id]),delete n[f.id],delete s[f.id]}return{bind:function(u,f){let p=f.program;i.uniformBlockBinding(u,p)},update:function(u,f){let p=n[u.id];p===void 0&&((function(_){let m=_.uniforms,v=0,y=16;for(let E=0,M=m.length;E<M;E++){let D=Array.isArray(m[E])?m[E]:[m[E]];for(let F=0,I=D.length;F<I;F++){let P=D[F],H=Array.isArray(P.value)?P.value:[P.value];for(let O=0,j=H.length;O<j;O++){let z=c(H[O]),k=v%y,q=k%z.boundary,X=k+q;v+=q,X!==0&&y-X<z.storage&&(v+=y-X),P.__data=new Float32Array(z.storage/Float32Array.BYTES_PER_ELEMENT),P.__offset=v,v+=z.storage}}}let w=v%y;w>0&&(v+=y-w),_.__size=v,_.__cache={}})(u),p=(function(_){let m=(function(){for(let E=0;E<o;E++)if(a.indexOf(E)===-1)return a.push(E),E;return Te("WebGLRenderer: Maximum number of simultaneously usable uniforms groups reached."),0})();_.__bindingPointIndex=m;let v=r.createBuffer(),y=_.__size,w=_.usage;return r.bindBuffer(r.UNIFORM_BUFFER,v),r.bufferData(r.UNIFORM_BUFFER,y,w),r.bindBuffer(r.UNIFORM_BUFFER,null),r.bindBufferBase(r.UNIFORM_BUFFER,m,v),v})(u),n[u.id]=p,u.addEventListener("dispose",h));let g=f.program;i.updateUBOMapping(u,g);let d=e.render.frame;s[u.id]!==d&&((function(_){let m=n[_.id],v=_.uniforms,y=_.__cache;r.bindBuffer(r.UNIFORM_BUFFER,m);for(let w=0,E=v.length;w<E;w++){let M=Array.isArray(v[w])?v[w]:[v[w]];for(let D=0,F=M.length;D<F;D++){let I=M[D];if(l(I,w,D,y)===!0){let P=I.__offset,H=Array.isArray(I.value)?I.value:[I.value],O=0;for(let j=0;j<H.length;j++){let z=H[j],k=c(z);typeof z=="number"||typeof z=="boolean"?(I.__data[0]=z,r.bufferSubData(r.UNIFORM_BUFFER,P+O,I.__data)):z.isMatrix3?(I.__data[0]=z.elements[0],I.__data[1]=z.elements[1],I.__data[2]=z.elements[2],I.__data[3]=0,I.__data[4]=z.elements[3],I.__data[5]=z.elements[4],I.__data[6]=z.elements[5],I.__data[7]=0,I.__data[8]=z.elements[6],I.__data[9]=z.elements[7],I.__data[10]=z.elements[8],I.__data[11]=0):ArrayBuffer.isView(z)?I.__data.set(new z.constructor(z.buffer,z.byteOffset,I.__data.length)):(z.toArray(I.__data,O),O+=k.storage/Float32Array.BYTES_PER_ELEMENT)}r.bufferSubData(r.UNIFORM_BUFFER,P,I.__data)}}}r.bindBuffer(r.UNIFORM_BUFFER,null)})(u),s[u.id]=d)},dispose:function(){for(let u in n)r.deleteBuffer(n[u]);a=[],n={},s={}}}}Ap.set(-1,0,0,0,1,0,0,0,1);var O0=new Uint16Array([12469,15057,12620,14925,13266,14620,13807,14376,14323,13990,14545,13625,14713,13328,14840,12882,14931,12528,14996,12233,15039,11829,15066,11525,15080,11295,15085,10976,15082,10705,15073,10495,13880,14564,13898,14542,13977,14430,14158,14124,14393,13732,14556,13410,14702,12996,14814,12596,14891,12291,14937,11834,14957,11489,14958,11194,14943,10803,14921,10506,14893,10278,14858,9960,14484,14039,14487,14025,14499,13941,14524,13740,14574,13468,14654,13106,14743,12678,14818,12344,14867,11893,14889,11509,14893,11180,14881,10751,14852,10428,14812,10128,14765,9754,14712,9466,14764,13480,14764,13475,14766,13440,14766,13347,14769,13070,14786,12713,14816,12387,14844,11957,14860,11549,14868,11215,14855,10751,14825,10403,14782,10044,14729,9651,14666,9352,14599,9029,14967,12835,14966,12831,14963,12804,14954,12723,14936,12564,14917,12347,14900,11958,14886,11569,14878,11247,14859,10765,14828,10401,14784,10011,14727,9600,14660,9289,14586,8893,14508,8533,15111,12234,15110,12234,15104,12216,15092,12156,15067,12010,15028,11776,14981,11500,14942,11205,14902,10752,14861,10393,14812,9991,14752,9570,14682,9252,14603,8808,14519,8445,14431,8145,15209,11449,15208,11451,15202,11451,15190,11438,15163,11384,15117,11274,15055,10979,14994,10648,14932,10343,14871,9936,14803,9532,14729,9218,14645,8742,14556,8381,14461,8020,14365,7603,15273,10603,15272,10607,15267,10619,15256,10631,15231,10614,15182,10535,15118,10389,15042,10167,14963,9787,14883,9447,14800,9115,14710,8665,14615,8318,14514,7911,14411,7507,14279,7198,15314,9675,15313,9683,15309,9712,15298,9759,15277,9797,15229,9773,15166,9668,15084,9487,14995,9274,14898,8910,14800,8539,14697,8234,14590,7790,14479,7409,14367,7067,14178,6621,15337,8619,15337,8631,15333,8677,15325,8769,15305,8871,15264,8940,15202,8909,15119,8775,15022,8565,14916,8328,14804,8009,14688,7614,14569,7287,14448,6888,14321,6483,14088,6171,15350,7402,15350,7419,15347,7480,15340,7613,15322,7804,15287,7973,15229,8057,15148,8012,15046,7846,14933,7611,14810,7357,14682,7069,14552,6656,14421,6316,14251,5948,14007,5528,15356,5942,15356,5977,15353,6119,15348,6294,15332,6551,15302,6824,15249,7044,15171,7122,15070,7050,14949,6861,14818,6611,14679,6349,14538,6067,14398,5651,14189,5311,13935,4958,15359,4123,15359,4153,15356,4296,15353,4646,15338,5160,15311,5508,15263,5829,15188,6042,15088,6094,14966,6001,14826,5796,14678,5543,14527,5287,14377,4985,14133,4586,13869,4257,15360,1563,15360,1642,15358,2076,15354,2636,15341,3350,15317,4019,15273,4429,15203,4732,15105,4911,14981,4932,14836,4818,14679,4621,14517,4386,14359,4156,14083,3795,13808,3437,15360,122,15360,137,15358,285,15355,636,15344,1274,15322,2177,15281,2765,15215,3223,15120,3451,14995,3569,14846,3567,14681,3466,14511,3305,14344,3121,14037,2800,13753,2467,15360,0,15360,1,15359,21,15355,89,15346,253,15325,479,15287,796,15225,1148,15133,1492,15008,1749,14856,1882,14685,1886,14506,1783,14324,1608,13996,1398,13702,1183]),Ii=null,Ro=class{constructor(e={}){let{canvas:t=Hd(),context:i=null,depth:n=!0,stencil:s=!1,alpha:a=!1,antialias:o=!1,premultipliedAlpha:l=!0,preserveDrawingBuffer:c=!1,powerPreference:h="default",failIfMajorPerformanceCaveat:u=!1,reversedDepthBuffer:f=!1,outputBufferType:p=zt}=e,g;if(this.isWebGLRenderer=!0,i!==null){if(typeof WebGLRenderingContext<"u"&&i instanceof WebGLRenderingContext)throw new Error("THREE.WebGLRenderer: WebGL 1 is not supported since r163.");g=i.getContextAttributes().alpha}else g=a;let d=p,_=new Set([bc,Sc,In]),m=new Set([zt,Vi,an,mr,fo,mo]),v=new Uint32Array(4),y=new Int32Array(4),w=new A,E=null,M=null,D=[],F=[],I=null;this.domElement=t,this.debug={checkShaderErrors:!0,onShaderError:null},this.autoClear=!0,this.autoClearColor=!0,this.autoClearDepth=!0,this.autoClearStencil=!0,this.sortObjects=!0,this.clippingPlanes=[],this.localClippingEnabled=!1,this.toneMapping=mi,this.toneMappingExposure=1,this.transmissionResolutionScale=1;let P=this,H=!1,O=null;this._outputColorSpace=Yt;let j=0,z=0,k=null,q=-1,X=null,oe=new $e,ue=new $e,be=null,ye=new je(0),xe=0,ee=t.width,ae=t.height,ie=1,ve=null,ke=null,te=new $e(0,0,ee,ae),R=new $e(0,0,ee,ae),S=!1,C=new wn,N=!1,x=!1,L=new De,U=new A,T=new $e,V={background:null,fog:null,environment:null,overrideMaterial:null,isScene:!0},W=!1;function $(){return k===null?ie:1}let Q,de,Z,fe,ce,pe,se,Me,ze,nt,qe,rt,Ft,Se,Oe,Ce,tt,Pt,vi,Qt,_t,Gt,Nn,B=i;function Nh(b,G){return t.getContext(b,G)}try{let b={alpha:!0,depth:n,stencil:s,antialias:o,premultipliedAlpha:l,preserveDrawingBuffer:c,powerPreference:h,failIfMajorPerformanceCaveat:u};if("setAttribute"in t&&t.setAttribute("data-engine",`three.js r${"184"}`),t.addEventListener("webglcontextlost",Oh,!1),t.addEventListener("webglcontextrestored",Bh,!1),t.addEventListener("webglcontextcreationerror",kh,!1),B===null){let G="webgl2";if(B=Nh(G,b),B===null)throw Nh(G)?new Error("Error creating WebGL context with your selected attributes."):new Error("Error creating WebGL context.")}}catch(b){throw Te("WebGLRenderer: "+b.message),b}function Fh(){Q=new hg(B),Q.init(),_t=new U0(B,Q),de=new ag(B,Q,e,_t),Z=new P0(B,Q),de.reversedDepthBuffer&&f&&Z.buffers.depth.setReversed(!0),fe=new pg(B),ce=new y0,pe=new L0(B,Q,Z,ce,de,_t,fe),se=new cg(P),Me=new tg(B),Gt=new rg(B,Me),ze=new ug(B,Me,fe,Gt),nt=new mg(B,ze,Me,Gt,fe),Pt=new fg(B,de,pe),Oe=new og(ce),qe=new x0(P,se,Q,de,Gt,Oe),rt=new N0(P,ce),Ft=new S0,Se=new A0(Q),tt=new ng(P,se,Z,nt,g,l),Ce=new I0(P,nt,de),Nn=new F0(B,fe,de,Z),vi=new sg(B,Q,fe),Qt=new dg(B,Q,fe),fe.programs=qe.programs,P.capabilities=de,P.extensions=Q,P.properties=ce,P.renderLists=Ft,P.shadowMap=Ce,P.state=Z,P.info=fe}Fh(),d!==zt&&(I=new vg(d,t.width,t.height,n,s));let dt=new yh(P,B);function Oh(b){b.preventDefault(),th("WebGLRenderer: Context Lost."),H=!0}function Bh(){th("WebGLRenderer: Context Restored."),H=!1;let b=fe.autoReset,G=Ce.enabled,Y=Ce.autoUpdate,J=Ce.needsUpdate,K=Ce.type;Fh(),fe.autoReset=b,Ce.enabled=G,Ce.autoUpdate=Y,Ce.needsUpdate=J,Ce.type=K}function kh(b){Te("WebGLRenderer: A WebGL context could not be created. Reason: ",b.statusMessage)}function zh(b){let G=b.target;G.removeEventListener("dispose",zh),(function(Y){(function(J){let K=ce.get(J).programs;K!==void 0&&(K.forEach(function(re){qe.releaseProgram(re)}),J.isShaderMaterial&&qe.releaseShaderCache(J))})(Y),ce.remove(Y)})(G)}function Gh(b,G,Y){b.transparent===!0&&b.side===Ai&&b.forceSinglePass===!1?(b.side=Wt,b.needsUpdate=!0,Es(b,G,Y),b.side=dr,b.needsUpdate=!0,Es(b,G,Y),b.side=Ai):Es(b,G,Y)}this.xr=dt,this.getContext=function(){return B},this.getContextAttributes=function(){return B.getContextAttributes()},this.forceContextLoss=function(){let b=Q.get("WEBGL_lose_context");b&&b.loseContext()},this.forceContextRestore=function(){let b=Q.get("WEBGL_lose_context");b&&b.restoreContext()},this.getPixelRatio=function(){return ie},this.setPixelRatio=function(b){b!==void 0&&(ie=b,this.setSize(ee,ae,!1))},this.getSize=function(b){return b.set(ee,ae)},this.setSize=function(b,G,Y=!0){dt.isPresenting?we("WebGLRenderer: Can't change size while VR device is presenting."):(ee=b,ae=G,t.width=Math.floor(b*ie),t.height=Math.floor(G*ie),Y===!0&&(t.style.width=b+"px",t.style.height=G+"px"),I!==null&&I.setSize(t.width,t.height),this.setViewport(0,0,b,G))},this.getDrawingBufferSize=function(b){return b.set(ee*ie,ae*ie).floor()},this.setDrawingBufferSize=function(b,G,Y){ee=b,ae=G,ie=Y,t.width=Math.floor(b*Y),t.height=Math.floor(G*Y),this.setViewport(0,0,b,G)},this.setEffects=function(b){if(d!==zt){if(b){for(let G=0;G<b.length;G++)if(b[G].isOutputPass===!0){we("THREE.WebGLRenderer: OutputPass is not needed in setEffects(). Tone mapping and color space conversion are applied automatically.");break}}I.setEffects(b||[])}else Te("THREE.WebGLRenderer: setEffects() requires outputBufferType set to HalfFloatType or FloatType.")},this.getCurrentViewport=function(b){return b.copy(oe)},this.getViewport=function(b){return b.copy(te)},this.setViewport=function(b,G,Y,J){b.isVector4?te.set(b.x,b.y,b.z,b.w):te.set(b,G,Y,J),Z.viewport(oe.copy(te).multiplyScalar(ie).round())},this.getScissor=function(b){return b.copy(R)},this.setScissor=function(b,G,Y,J){b.isVector4?R.set(b.x,b.y,b.z,b.w):R.set(b,G,Y,J),Z.scissor(ue.copy(R).multiplyScalar(ie).round())},this.getScissorTest=function(){return S},this.setScissorTest=function(b){Z.setScissorTest(S=b)},this.setOpaqueSort=function(b){ve=b},this.setTransparentSort=function(b){ke=b},this.getClearColor=function(b){return b.copy(tt.getClearColor())},this.setClearColor=function(){tt.setClearColor(...arguments)},this.getClearAlpha=function(){return tt.getClearAlpha()},this.setClearAlpha=function(){tt.setClearAlpha(...arguments)},this.clear=function(b=!0,G=!0,Y=!0){let J=0;if(b){let K=!1;if(k!==null){let re=k.texture.format;K=_.has(re)}if(K){let re=k.texture.type,he=m.has(re),ge=tt.getClearColor(),_e=tt.getClearAlpha(),Re=ge.r,We=ge.g,Xe=ge.b;he?(v[0]=Re,v[1]=We,v[2]=Xe,v[3]=_e,B.clearBufferuiv(B.COLOR,0,v)):(y[0]=Re,y[1]=We,y[2]=Xe,y[3]=_e,B.clearBufferiv(B.COLOR,0,y))}else J|=B.COLOR_BUFFER_BIT}G&&(J|=B.DEPTH_BUFFER_BIT,this.state.buffers.depth.setMask(!0)),Y&&(J|=B.STENCIL_BUFFER_BIT,this.state.buffers.stencil.setMask(4294967295)),J!==0&&B.clear(J)},this.clearColor=function(){this.clear(!0,!1,!1)},this.clearDepth=function(){this.clear(!1,!0,!1)},this.clearStencil=function(){this.clear(!1,!1,!0)},this.setNodesHandler=function(b){b.setRenderer(this),O=b},this.dispose=function(){t.removeEventListener("webglcontextlost",Oh,!1),t.removeEventListener("webglcontextrestored",Bh,!1),t.removeEventListener("webglcontextcreationerror",kh,!1),tt.dispose(),Ft.dispose(),Se.dispose(),ce.dispose(),se.dispose(),nt.dispose(),Gt.dispose(),Nn.dispose(),qe.dispose(),dt.dispose(),dt.removeEventListener("sessionstart",Vh),dt.removeEventListener("sessionend",Hh),hn.stop()},this.renderBufferDirect=function(b,G,Y,J,K,re){G===null&&(G=V);let he=K.isMesh&&K.matrixWorld.determinant()<0,ge=(function(Ge,at,Tt,Ie,Le){at.isScene!==!0&&(at=V),pe.resetTextureUnits();let si=at.fog,Xo=Ie.isMeshStandardMaterial||Ie.isMeshLambertMaterial||Ie.isMeshPhongMaterial?at.environment:null,As=k===null?P.outputColorSpace:k.isXRRenderTarget===!0?k.texture.colorSpace:Ve.workingColorSpace,Mr=Ie.isMeshStandardMaterial||Ie.isMeshLambertMaterial&&!Ie.envMap||Ie.isMeshPhongMaterial&&!Ie.envMap,_i=se.get(Ie.envMap||Xo,Mr),Fn=Ie.vertexColors===!0&&!!Tt.attributes.color&&Tt.attributes.color.itemSize===4,Li=!!Tt.attributes.tangent&&(!!Ie.normalMap||Ie.anisotropy>0),jo=!!Tt.morphAttributes.position,On=!!Tt.morphAttributes.normal,vf=!!Tt.morphAttributes.color,Zh=mi;Ie.toneMapped&&(k!==null&&k.isXRRenderTarget!==!0||(Zh=P.toneMapping));let Kh=Tt.morphAttributes.position||Tt.morphAttributes.normal||Tt.morphAttributes.color,_f=Kh!==void 0?Kh.length:0,Pe=ce.get(Ie),un=M.state.lights;if(N===!0&&(x===!0||Ge!==X)){let ft=Ge===X&&Ie.id===q;Oe.setState(Ie,Ge,ft)}let ai=!1;Ie.version===Pe.__version?Pe.needsLights&&Pe.lightsStateVersion!==un.state.version||Pe.outputColorSpace!==As||Le.isBatchedMesh&&Pe.batching===!1?ai=!0:Le.isBatchedMesh||Pe.batching!==!0?Le.isBatchedMesh&&Pe.batchingColor===!0&&Le.colorTexture===null||Le.isBatchedMesh&&Pe.batchingColor===!1&&Le.colorTexture!==null||Le.isInstancedMesh&&Pe.instancing===!1?ai=!0:Le.isInstancedMesh||Pe.instancing!==!0?Le.isSkinnedMesh&&Pe.skinning===!1?ai=!0:Le.isSkinnedMesh||Pe.skinning!==!0?Le.isInstancedMesh&&Pe.instancingColor===!0&&Le.instanceColor===null||Le.isInstancedMesh&&Pe.instancingColor===!1&&Le.instanceColor!==null||Le.isInstancedMesh&&Pe.instancingMorph===!0&&Le.morphTexture===null||Le.isInstancedMesh&&Pe.instancingMorph===!1&&Le.morphTexture!==null||Pe.envMap!==_i||Ie.fog===!0&&Pe.fog!==si?ai=!0:Pe.numClippingPlanes===void 0||Pe.numClippingPlanes===Oe.numPlanes&&Pe.numIntersection===Oe.numIntersection?(Pe.vertexAlphas!==Fn||Pe.vertexTangents!==Li||Pe.morphTargets!==jo||Pe.morphNormals!==On||Pe.morphColors!==vf||Pe.toneMapping!==Zh||Pe.morphTargetsCount!==_f||!!Pe.lightProbeGrid!=M.state.lightProbeGridArray.length>0)&&(ai=!0):ai=!0:ai=!0:ai=!0:ai=!0:(ai=!0,Pe.__version=Ie.version);let Wi=Pe.currentProgram;ai===!0&&(Wi=Es(Ie,at,Le),O&&Ie.isNodeMaterial&&O.onUpdateProgram(Ie,Wi,Pe));let $h=!1,Bn=!1,qo=!1,ot=Wi.getUniforms(),ei=Pe.uniforms;if(Z.useProgram(Wi.program)&&($h=!0,Bn=!0,qo=!0),Ie.id!==q&&(q=Ie.id,Bn=!0),Pe.needsLights){let ft=(function(yi,Zo){if(yi.length===0)return null;if(yi.length===1)return yi[0].texture!==null?yi[0]:null;w.setFromMatrixPosition(Zo.matrixWorld);for(let kn=0,xf=yi.length;kn<xf;kn++){let Ko=yi[kn];if(Ko.texture!==null&&Ko.boundingBox.containsPoint(w))return Ko}return null})(M.state.lightProbeGridArray,Le);Pe.lightProbeGrid!==ft&&(Pe.lightProbeGrid=ft,Bn=!0)}if($h||X!==Ge){Z.buffers.depth.getReversed()&&Ge.reversedDepth!==!0&&(Ge._reversedDepth=!0,Ge.updateProjectionMatrix()),ot.setValue(B,"projectionMatrix",Ge.projectionMatrix),ot.setValue(B,"viewMatrix",Ge.matrixWorldInverse);let ft=ot.map.cameraPosition;ft!==void 0&&ft.setValue(B,U.setFromMatrixPosition(Ge.matrixWorld)),de.logarithmicDepthBuffer&&ot.setValue(B,"logDepthBufFC",2/(Math.log(Ge.far+1)/Math.LN2)),(Ie.isMeshPhongMaterial||Ie.isMeshToonMaterial||Ie.isMeshLambertMaterial||Ie.isMeshBasicMaterial||Ie.isMeshStandardMaterial||Ie.isShaderMaterial)&&ot.setValue(B,"isOrthographic",Ge.isOrthographicCamera===!0),X!==Ge&&(X=Ge,Bn=!0,qo=!0)}if(Pe.needsLights&&(un.state.directionalShadowMap.length>0&&ot.setValue(B,"directionalShadowMap",un.state.directionalShadowMap,pe),un.state.spotShadowMap.length>0&&ot.setValue(B,"spotShadowMap",un.state.spotShadowMap,pe),un.state.pointShadowMap.length>0&&ot.setValue(B,"pointShadowMap",un.state.pointShadowMap,pe)),Le.isSkinnedMesh){ot.setOptional(B,Le,"bindMatrix"),ot.setOptional(B,Le,"bindMatrixInverse");let ft=Le.skeleton;ft&&(ft.boneTexture===null&&ft.computeBoneTexture(),ot.setValue(B,"boneTexture",ft.boneTexture,pe))}Le.isBatchedMesh&&(ot.setOptional(B,Le,"batchingTexture"),ot.setValue(B,"batchingTexture",Le._matricesTexture,pe),ot.setOptional(B,Le,"batchingIdTexture"),ot.setValue(B,"batchingIdTexture",Le._indirectTexture,pe),ot.setOptional(B,Le,"batchingColorTexture"),Le._colorsTexture!==null&&ot.setValue(B,"batchingColorTexture",Le._colorsTexture,pe));let Yo=Tt.morphAttributes;if(Yo.position===void 0&&Yo.normal===void 0&&Yo.color===void 0||Pt.update(Le,Tt,Wi),(Bn||Pe.receiveShadow!==Le.receiveShadow)&&(Pe.receiveShadow=Le.receiveShadow,ot.setValue(B,"receiveShadow",Le.receiveShadow)),(Ie.isMeshStandardMaterial||Ie.isMeshLambertMaterial||Ie.isMeshPhongMaterial)&&Ie.envMap===null&&at.environment!==null&&(ei.envMapIntensity.value=at.environmentIntensity),ei.dfgLUT!==void 0&&(ei.dfgLUT.value=(Ii===null&&(Ii=new bn(O0,16,16,Pn,Ci),Ii.name="DFG_LUT",Ii.minFilter=wt,Ii.magFilter=wt,Ii.wrapS=di,Ii.wrapT=di,Ii.generateMipmaps=!1,Ii.needsUpdate=!0),Ii)),Bn){if(ot.setValue(B,"toneMappingExposure",P.toneMappingExposure),Pe.needsLights&&(oi=qo,(xi=ei).ambientLightColor.needsUpdate=oi,xi.lightProbe.needsUpdate=oi,xi.directionalLights.needsUpdate=oi,xi.directionalLightShadows.needsUpdate=oi,xi.pointLights.needsUpdate=oi,xi.pointLightShadows.needsUpdate=oi,xi.spotLights.needsUpdate=oi,xi.spotLightShadows.needsUpdate=oi,xi.rectAreaLights.needsUpdate=oi,xi.hemisphereLights.needsUpdate=oi),si&&Ie.fog===!0&&rt.refreshFogUniforms(ei,si),rt.refreshMaterialUniforms(ei,Ie,ie,ae,M.state.transmissionRenderTarget[Ge.id]),Pe.needsLights&&Pe.lightProbeGrid){let ft=Pe.lightProbeGrid;ei.probesSH.value=ft.texture,ei.probesMin.value.copy(ft.boundingBox.min),ei.probesMax.value.copy(ft.boundingBox.max),ei.probesResolution.value.copy(ft.resolution)}_r.upload(B,qh(Pe),ei,pe)}var xi,oi;if(Ie.isShaderMaterial&&Ie.uniformsNeedUpdate===!0&&(_r.upload(B,qh(Pe),ei,pe),Ie.uniformsNeedUpdate=!1),Ie.isSpriteMaterial&&ot.setValue(B,"center",Le.center),ot.setValue(B,"modelViewMatrix",Le.modelViewMatrix),ot.setValue(B,"normalMatrix",Le.normalMatrix),ot.setValue(B,"modelMatrix",Le.matrixWorld),Ie.uniformsGroups!==void 0){let ft=Ie.uniformsGroups;for(let yi=0,Zo=ft.length;yi<Zo;yi++){let kn=ft[yi];Nn.update(kn,Wi),Nn.bind(kn,Wi)}}return Wi})(b,G,Y,J,K);Z.setMaterial(J,he);let _e=Y.index,Re=1;if(J.wireframe===!0){if(_e=ze.getWireframeAttribute(Y),_e===void 0)return;Re=2}let We=Y.drawRange,Xe=Y.attributes.position,Ee=We.start*Re,Ye=(We.start+We.count)*Re;re!==null&&(Ee=Math.max(Ee,re.start*Re),Ye=Math.min(Ye,(re.start+re.count)*Re)),_e!==null?(Ee=Math.max(Ee,0),Ye=Math.min(Ye,_e.count)):Xe!=null&&(Ee=Math.max(Ee,0),Ye=Math.min(Ye,Xe.count));let xt=Ye-Ee;if(xt<0||xt===1/0)return;let pt;Gt.setup(K,J,ge,Y,_e);let st=vi;if(_e!==null&&(pt=Me.get(_e),st=Qt,st.setIndex(pt)),K.isMesh)J.wireframe===!0?(Z.setLineWidth(J.wireframeLinewidth*$()),st.setMode(B.LINES)):st.setMode(B.TRIANGLES);else if(K.isLine){let Ge=J.linewidth;Ge===void 0&&(Ge=1),Z.setLineWidth(Ge*$()),K.isLineSegments?st.setMode(B.LINES):K.isLineLoop?st.setMode(B.LINE_LOOP):st.setMode(B.LINE_STRIP)}else K.isPoints?st.setMode(B.POINTS):K.isSprite&&st.setMode(B.TRIANGLES);if(K.isBatchedMesh)if(Q.get("WEBGL_multi_draw"))st.renderMultiDraw(K._multiDrawStarts,K._multiDrawCounts,K._multiDrawCount);else{let Ge=K._multiDrawStarts,at=K._multiDrawCounts,Tt=K._multiDrawCount,Ie=_e?Me.get(_e).bytesPerElement:1,Le=ce.get(J).currentProgram.getUniforms();for(let si=0;si<Tt;si++)Le.setValue(B,"_gl_DrawID",si),st.render(Ge[si]/Ie,at[si])}else if(K.isInstancedMesh)st.renderInstances(Ee,xt,K.count);else if(Y.isInstancedBufferGeometry){let Ge=Y._maxInstanceCount!==void 0?Y._maxInstanceCount:1/0,at=Math.min(Y.instanceCount,Ge);st.renderInstances(Ee,xt,at)}else st.render(Ee,xt)},this.compile=function(b,G,Y=null){Y===null&&(Y=b),M=Se.get(Y),M.init(G),F.push(M),Y.traverseVisible(function(K){K.isLight&&K.layers.test(G.layers)&&(M.pushLight(K),K.castShadow&&M.pushShadow(K))}),b!==Y&&b.traverseVisible(function(K){K.isLight&&K.layers.test(G.layers)&&(M.pushLight(K),K.castShadow&&M.pushShadow(K))}),M.setupLights();let J=new Set;return b.traverse(function(K){if(!(K.isMesh||K.isPoints||K.isLine||K.isSprite))return;let re=K.material;if(re)if(Array.isArray(re))for(let he=0;he<re.length;he++){let ge=re[he];Gh(ge,Y,K),J.add(ge)}else Gh(re,Y,K),J.add(re)}),M=F.pop(),J},this.compileAsync=function(b,G,Y=null){let J=this.compile(b,G,Y);return new Promise(K=>{function re(){J.forEach(function(he){ce.get(he).currentProgram.isReady()&&J.delete(he)}),J.size!==0?setTimeout(re,10):K(b)}Q.get("KHR_parallel_shader_compile")!==null?re():setTimeout(re,10)})};let Ho=null;function Vh(){hn.stop()}function Hh(){hn.start()}let hn=new Mp;function Wo(b,G,Y,J){if(b.visible===!1)return;if(b.layers.test(G.layers)){if(b.isGroup)Y=b.renderOrder;else if(b.isLOD)b.autoUpdate===!0&&b.update(G);else if(b.isLightProbeGrid)M.pushLightProbeGrid(b);else if(b.isLight)M.pushLight(b),b.castShadow&&M.pushShadow(b);else if(b.isSprite){if(!b.frustumCulled||C.intersectsSprite(b)){J&&T.setFromMatrixPosition(b.matrixWorld).applyMatrix4(L);let re=nt.update(b),he=b.material;he.visible&&E.push(b,re,he,Y,T.z,null)}}else if((b.isMesh||b.isLine||b.isPoints)&&(!b.frustumCulled||C.intersectsObject(b))){let re=nt.update(b),he=b.material;if(J&&(b.boundingSphere!==void 0?(b.boundingSphere===null&&b.computeBoundingSphere(),T.copy(b.boundingSphere.center)):(re.boundingSphere===null&&re.computeBoundingSphere(),T.copy(re.boundingSphere.center)),T.applyMatrix4(b.matrixWorld).applyMatrix4(L)),Array.isArray(he)){let ge=re.groups;for(let _e=0,Re=ge.length;_e<Re;_e++){let We=ge[_e],Xe=he[We.materialIndex];Xe&&Xe.visible&&E.push(b,re,Xe,Y,T.z,We)}}else he.visible&&E.push(b,re,he,Y,T.z,null)}}let K=b.children;for(let re=0,he=K.length;re<he;re++)Wo(K[re],G,Y,J)}function Wh(b,G,Y,J){let{opaque:K,transmissive:re,transparent:he}=b;M.setupLightsView(Y),N===!0&&Oe.setGlobalState(P.clippingPlanes,Y),J&&Z.viewport(oe.copy(J)),K.length>0&&Ts(K,G,Y),re.length>0&&Ts(re,G,Y),he.length>0&&Ts(he,G,Y),Z.buffers.depth.setTest(!0),Z.buffers.depth.setMask(!0),Z.buffers.color.setMask(!0),Z.setPolygonOffset(!1)}function Xh(b,G,Y,J){if((Y.isScene===!0?Y.overrideMaterial:null)!==null)return;if(M.state.transmissionRenderTarget[J.id]===void 0){let Xe=Q.has("EXT_color_buffer_half_float")||Q.has("EXT_color_buffer_float");M.state.transmissionRenderTarget[J.id]=new kt(1,1,{generateMipmaps:!0,type:Xe?Ci:zt,minFilter:Cn,samples:Math.max(4,de.samples),stencilBuffer:s,resolveDepthBuffer:!1,resolveStencilBuffer:!1,colorSpace:Ve.workingColorSpace})}let K=M.state.transmissionRenderTarget[J.id],re=J.viewport||oe;K.setSize(re.z*P.transmissionResolutionScale,re.w*P.transmissionResolutionScale);let he=P.getRenderTarget(),ge=P.getActiveCubeFace(),_e=P.getActiveMipmapLevel();P.setRenderTarget(K),P.getClearColor(ye),xe=P.getClearAlpha(),xe<1&&P.setClearColor(16777215,.5),P.clear(),W&&tt.render(Y);let Re=P.toneMapping;P.toneMapping=mi;let We=J.viewport;if(J.viewport!==void 0&&(J.viewport=void 0),M.setupLightsView(J),N===!0&&Oe.setGlobalState(P.clippingPlanes,J),Ts(b,Y,J),pe.updateMultisampleRenderTarget(K),pe.updateRenderTargetMipmap(K),Q.has("WEBGL_multisampled_render_to_texture")===!1){let Xe=!1;for(let Ee=0,Ye=G.length;Ee<Ye;Ee++){let xt=G[Ee],{object:pt,geometry:st,material:Ge,group:at}=xt;if(Ge.side===Ai&&pt.layers.test(J.layers)){let Tt=Ge.side;Ge.side=Wt,Ge.needsUpdate=!0,jh(pt,Y,J,st,Ge,at),Ge.side=Tt,Ge.needsUpdate=!0,Xe=!0}}Xe===!0&&(pe.updateMultisampleRenderTarget(K),pe.updateRenderTargetMipmap(K))}P.setRenderTarget(he,ge,_e),P.setClearColor(ye,xe),We!==void 0&&(J.viewport=We),P.toneMapping=Re}function Ts(b,G,Y){let J=G.isScene===!0?G.overrideMaterial:null;for(let K=0,re=b.length;K<re;K++){let he=b[K],{object:ge,geometry:_e,group:Re}=he,We=he.material;We.allowOverride===!0&&J!==null&&(We=J),ge.layers.test(Y.layers)&&jh(ge,G,Y,_e,We,Re)}}function jh(b,G,Y,J,K,re){b.onBeforeRender(P,G,Y,J,K,re),b.modelViewMatrix.multiplyMatrices(Y.matrixWorldInverse,b.matrixWorld),b.normalMatrix.getNormalMatrix(b.modelViewMatrix),K.onBeforeRender(P,G,Y,J,b,re),K.transparent===!0&&K.side===Ai&&K.forceSinglePass===!1?(K.side=Wt,K.needsUpdate=!0,P.renderBufferDirect(Y,G,J,K,b,re),K.side=dr,K.needsUpdate=!0,P.renderBufferDirect(Y,G,J,K,b,re),K.side=Ai):P.renderBufferDirect(Y,G,J,K,b,re),b.onAfterRender(P,G,Y,J,K,re)}function Es(b,G,Y){G.isScene!==!0&&(G=V);let J=ce.get(b),K=M.state.lights,re=M.state.shadowsArray,he=K.state.version,ge=qe.getParameters(b,K.state,re,G,Y,M.state.lightProbeGridArray),_e=qe.getProgramCacheKey(ge),Re=J.programs;J.environment=b.isMeshStandardMaterial||b.isMeshLambertMaterial||b.isMeshPhongMaterial?G.environment:null,J.fog=G.fog;let We=b.isMeshStandardMaterial||b.isMeshLambertMaterial&&!b.envMap||b.isMeshPhongMaterial&&!b.envMap;J.envMap=se.get(b.envMap||J.environment,We),J.envMapRotation=J.environment!==null&&b.envMap===null?G.environmentRotation:b.envMapRotation,Re===void 0&&(b.addEventListener("dispose",zh),Re=new Map,J.programs=Re);let Xe=Re.get(_e);if(Xe!==void 0){if(J.currentProgram===Xe&&J.lightsStateVersion===he)return Yh(b,ge),Xe}else ge.uniforms=qe.getUniforms(b),O!==null&&b.isNodeMaterial&&O.build(b,Y,ge),b.onBeforeCompile(ge,P),Xe=qe.acquireProgram(ge,_e),Re.set(_e,Xe),J.uniforms=ge.uniforms;let Ee=J.uniforms;return(b.isShaderMaterial||b.isRawShaderMaterial)&&b.clipping!==!0||(Ee.clippingPlanes=Oe.uniform),Yh(b,ge),J.needsLights=(function(Ye){return Ye.isMeshLambertMaterial||Ye.isMeshToonMaterial||Ye.isMeshPhongMaterial||Ye.isMeshStandardMaterial||Ye.isShadowMaterial||Ye.isShaderMaterial&&Ye.lights===!0})(b),J.lightsStateVersion=he,J.needsLights&&(Ee.ambientLightColor.value=K.state.ambient,Ee.lightProbe.value=K.state.probe,Ee.directionalLights.value=K.state.directional,Ee.directionalLightShadows.value=K.state.directionalShadow,Ee.spotLights.value=K.state.spot,Ee.spotLightShadows.value=K.state.spotShadow,Ee.rectAreaLights.value=K.state.rectArea,Ee.ltc_1.value=K.state.rectAreaLTC1,Ee.ltc_2.value=K.state.rectAreaLTC2,Ee.pointLights.value=K.state.point,Ee.pointLightShadows.value=K.state.pointShadow,Ee.hemisphereLights.value=K.state.hemi,Ee.directionalShadowMatrix.value=K.state.directionalShadowMatrix,Ee.spotLightMatrix.value=K.state.spotLightMatrix,Ee.spotLightMap.value=K.state.spotLightMap,Ee.pointShadowMatrix.value=K.state.pointShadowMatrix),J.lightProbeGrid=M.state.lightProbeGridArray.length>0,J.currentProgram=Xe,J.uniformsList=null,Xe}function qh(b){if(b.uniformsList===null){let G=b.currentProgram.getUniforms();b.uniformsList=_r.seqWithValue(G.seq,b.uniforms)}return b.uniformsList}function Yh(b,G){let Y=ce.get(b);Y.outputColorSpace=G.outputColorSpace,Y.batching=G.batching,Y.batchingColor=G.batchingColor,Y.instancing=G.instancing,Y.instancingColor=G.instancingColor,Y.instancingMorph=G.instancingMorph,Y.skinning=G.skinning,Y.morphTargets=G.morphTargets,Y.morphNormals=G.morphNormals,Y.morphColors=G.morphColors,Y.morphTargetsCount=G.morphTargetsCount,Y.numClippingPlanes=G.numClippingPlanes,Y.numIntersection=G.numClipIntersection,Y.vertexAlphas=G.vertexAlphas,Y.vertexTangents=G.vertexTangents,Y.toneMapping=G.toneMapping}hn.setAnimationLoop(function(b){Ho&&Ho(b)}),typeof self<"u"&&hn.setContext(self),this.setAnimationLoop=function(b){Ho=b,dt.setAnimationLoop(b),b===null?hn.stop():hn.start()},dt.addEventListener("sessionstart",Vh),dt.addEventListener("sessionend",Hh),this.render=function(b,G){if(G!==void 0&&G.isCamera!==!0)return void Te("WebGLRenderer.render: camera is not an instance of THREE.Camera.");if(H===!0)return;O!==null&&O.renderStart(b,G);let Y=dt.enabled===!0&&dt.isPresenting===!0,J=I!==null&&(k===null||Y)&&I.begin(P,k);if(b.matrixWorldAutoUpdate===!0&&b.updateMatrixWorld(),G.parent===null&&G.matrixWorldAutoUpdate===!0&&G.updateMatrixWorld(),dt.enabled!==!0||dt.isPresenting!==!0||I!==null&&I.isCompositing()!==!1||(dt.cameraAutoUpdate===!0&&dt.updateCamera(G),G=dt.getCamera()),b.isScene===!0&&b.onBeforeRender(P,b,G,k),M=Se.get(b,F.length),M.init(G),M.state.textureUnits=pe.getTextureUnits(),F.push(M),L.multiplyMatrices(G.projectionMatrix,G.matrixWorldInverse),C.setFromProjectionMatrix(L,zi,G.reversedDepth),x=this.localClippingEnabled,N=Oe.init(this.clippingPlanes,x),E=Ft.get(b,D.length),E.init(),D.push(E),dt.enabled===!0&&dt.isPresenting===!0){let re=P.xr.getDepthSensingMesh();re!==null&&Wo(re,G,-1/0,P.sortObjects)}Wo(b,G,0,P.sortObjects),E.finish(),P.sortObjects===!0&&E.sort(ve,ke),W=dt.enabled===!1||dt.isPresenting===!1||dt.hasDepthSensing()===!1,W&&tt.addToRenderList(E,b),this.info.render.frame++,N===!0&&Oe.beginShadows();let K=M.state.shadowsArray;if(Ce.render(K,b,G),N===!0&&Oe.endShadows(),this.info.autoReset===!0&&this.info.reset(),(J&&I.hasRenderPass())===!1){let re=E.opaque,he=E.transmissive;if(M.setupLights(),G.isArrayCamera){let ge=G.cameras;if(he.length>0)for(let _e=0,Re=ge.length;_e<Re;_e++)Xh(re,he,b,ge[_e]);W&&tt.render(b);for(let _e=0,Re=ge.length;_e<Re;_e++){let We=ge[_e];Wh(E,b,We,We.viewport)}}else he.length>0&&Xh(re,he,b,G),W&&tt.render(b),Wh(E,b,G)}k!==null&&z===0&&(pe.updateMultisampleRenderTarget(k),pe.updateRenderTargetMipmap(k)),J&&I.end(P),b.isScene===!0&&b.onAfterRender(P,b,G),Gt.resetDefaultState(),q=-1,X=null,F.pop(),F.length>0?(M=F[F.length-1],pe.setTextureUnits(M.state.textureUnits),N===!0&&Oe.setGlobalState(P.clippingPlanes,M.state.camera)):M=null,D.pop(),E=D.length>0?D[D.length-1]:null,O!==null&&O.renderEnd()},this.getActiveCubeFace=function(){return j},this.getActiveMipmapLevel=function(){return z},this.getRenderTarget=function(){return k},this.setRenderTargetTextures=function(b,G,Y){let J=ce.get(b);J.__autoAllocateDepthBuffer=b.resolveDepthBuffer===!1,J.__autoAllocateDepthBuffer===!1&&(J.__useRenderToTexture=!1),ce.get(b.texture).__webglTexture=G,ce.get(b.depthTexture).__webglTexture=J.__autoAllocateDepthBuffer?void 0:Y,J.__hasExternalTextures=!0},this.setRenderTargetFramebuffer=function(b,G){let Y=ce.get(b);Y.__webglFramebuffer=G,Y.__useDefaultFramebuffer=G===void 0};let ff=B.createFramebuffer();this.setRenderTarget=function(b,G=0,Y=0){k=b,j=G,z=Y;let J=null,K=!1,re=!1;if(b){let he=ce.get(b);if(he.__useDefaultFramebuffer!==void 0)return Z.bindFramebuffer(B.FRAMEBUFFER,he.__webglFramebuffer),oe.copy(b.viewport),ue.copy(b.scissor),be=b.scissorTest,Z.viewport(oe),Z.scissor(ue),Z.setScissorTest(be),void(q=-1);if(he.__webglFramebuffer===void 0)pe.setupRenderTarget(b);else if(he.__hasExternalTextures)pe.rebindTextures(b,ce.get(b.texture).__webglTexture,ce.get(b.depthTexture).__webglTexture);else if(b.depthBuffer){let Re=b.depthTexture;if(he.__boundDepthTexture!==Re){if(Re!==null&&ce.has(Re)&&(b.width!==Re.image.width||b.height!==Re.image.height))throw new Error("WebGLRenderTarget: Attached DepthTexture is initialized to the incorrect size.");pe.setupDepthRenderbuffer(b)}}let ge=b.texture;(ge.isData3DTexture||ge.isDataArrayTexture||ge.isCompressedArrayTexture)&&(re=!0);let _e=ce.get(b).__webglFramebuffer;b.isWebGLCubeRenderTarget?(J=Array.isArray(_e[G])?_e[G][Y]:_e[G],K=!0):J=b.samples>0&&pe.useMultisampledRTT(b)===!1?ce.get(b).__webglMultisampledFramebuffer:Array.isArray(_e)?_e[Y]:_e,oe.copy(b.viewport),ue.copy(b.scissor),be=b.scissorTest}else oe.copy(te).multiplyScalar(ie).floor(),ue.copy(R).multiplyScalar(ie).floor(),be=S;if(Y!==0&&(J=ff),Z.bindFramebuffer(B.FRAMEBUFFER,J)&&Z.drawBuffers(b,J),Z.viewport(oe),Z.scissor(ue),Z.setScissorTest(be),K){let he=ce.get(b.texture);B.framebufferTexture2D(B.FRAMEBUFFER,B.COLOR_ATTACHMENT0,B.TEXTURE_CUBE_MAP_POSITIVE_X+G,he.__webglTexture,Y)}else if(re){let he=G;for(let ge=0;ge<b.textures.length;ge++){let _e=ce.get(b.textures[ge]);B.framebufferTextureLayer(B.FRAMEBUFFER,B.COLOR_ATTACHMENT0+ge,_e.__webglTexture,Y,he)}}else if(b!==null&&Y!==0){let he=ce.get(b.texture);B.framebufferTexture2D(B.FRAMEBUFFER,B.COLOR_ATTACHMENT0,B.TEXTURE_2D,he.__webglTexture,Y)}q=-1},this.readRenderTargetPixels=function(b,G,Y,J,K,re,he,ge=0){if(!b||!b.isWebGLRenderTarget)return void Te("WebGLRenderer.readRenderTargetPixels: renderTarget is not THREE.WebGLRenderTarget.");let _e=ce.get(b).__webglFramebuffer;if(b.isWebGLCubeRenderTarget&&he!==void 0&&(_e=_e[he]),_e){Z.bindFramebuffer(B.FRAMEBUFFER,_e);try{let Re=b.textures[ge],We=Re.format,Xe=Re.type;if(b.textures.length>1&&B.readBuffer(B.COLOR_ATTACHMENT0+ge),!de.textureFormatReadable(We))return void Te("WebGLRenderer.readRenderTargetPixels: renderTarget is not in RGBA or implementation defined format.");if(!de.textureTypeReadable(Xe))return void Te("WebGLRenderer.readRenderTargetPixels: renderTarget is not in UnsignedByteType or implementation defined type.");G>=0&&G<=b.width-J&&Y>=0&&Y<=b.height-K&&B.readPixels(G,Y,J,K,_t.convert(We),_t.convert(Xe),re)}finally{let Re=k!==null?ce.get(k).__webglFramebuffer:null;Z.bindFramebuffer(B.FRAMEBUFFER,Re)}}},this.readRenderTargetPixelsAsync=async function(b,G,Y,J,K,re,he,ge=0){if(!b||!b.isWebGLRenderTarget)throw new Error("THREE.WebGLRenderer.readRenderTargetPixels: renderTarget is not THREE.WebGLRenderTarget.");let _e=ce.get(b).__webglFramebuffer;if(b.isWebGLCubeRenderTarget&&he!==void 0&&(_e=_e[he]),_e){if(G>=0&&G<=b.width-J&&Y>=0&&Y<=b.height-K){Z.bindFramebuffer(B.FRAMEBUFFER,_e);let Re=b.textures[ge],We=Re.format,Xe=Re.type;if(b.textures.length>1&&B.readBuffer(B.COLOR_ATTACHMENT0+ge),!de.textureFormatReadable(We))throw new Error("THREE.WebGLRenderer.readRenderTargetPixelsAsync: renderTarget is not in RGBA or implementation defined format.");if(!de.textureTypeReadable(Xe))throw new Error("THREE.WebGLRenderer.readRenderTargetPixelsAsync: renderTarget is not in UnsignedByteType or implementation defined type.");let Ee=B.createBuffer();B.bindBuffer(B.PIXEL_PACK_BUFFER,Ee),B.bufferData(B.PIXEL_PACK_BUFFER,re.byteLength,B.STREAM_READ),B.readPixels(G,Y,J,K,_t.convert(We),_t.convert(Xe),0);let Ye=k!==null?ce.get(k).__webglFramebuffer:null;Z.bindFramebuffer(B.FRAMEBUFFER,Ye);let xt=B.fenceSync(B.SYNC_GPU_COMMANDS_COMPLETE,0);return B.flush(),await Xd(B,xt,4),B.bindBuffer(B.PIXEL_PACK_BUFFER,Ee),B.getBufferSubData(B.PIXEL_PACK_BUFFER,0,re),B.deleteBuffer(Ee),B.deleteSync(xt),re}throw new Error("THREE.WebGLRenderer.readRenderTargetPixelsAsync: requested read bounds are out of range.")}},this.copyFramebufferToTexture=function(b,G=null,Y=0){let J=Math.pow(2,-Y),K=Math.floor(b.image.width*J),re=Math.floor(b.image.height*J),he=G!==null?G.x:0,ge=G!==null?G.y:0;pe.setTexture2D(b,0),B.copyTexSubImage2D(B.TEXTURE_2D,Y,0,0,he,ge,K,re),Z.unbindTexture()};let mf=B.createFramebuffer(),gf=B.createFramebuffer();this.copyTextureToTexture=function(b,G,Y=null,J=null,K=0,re=0){let he,ge,_e,Re,We,Xe,Ee,Ye,xt,pt=b.isCompressedTexture?b.mipmaps[re]:b.image;if(Y!==null)he=Y.max.x-Y.min.x,ge=Y.max.y-Y.min.y,_e=Y.isBox3?Y.max.z-Y.min.z:1,Re=Y.min.x,We=Y.min.y,Xe=Y.isBox3?Y.min.z:0;else{let _i=Math.pow(2,-K);he=Math.floor(pt.width*_i),ge=Math.floor(pt.height*_i),_e=b.isDataArrayTexture?pt.depth:b.isData3DTexture?Math.floor(pt.depth*_i):1,Re=0,We=0,Xe=0}J!==null?(Ee=J.x,Ye=J.y,xt=J.z):(Ee=0,Ye=0,xt=0);let st=_t.convert(G.format),Ge=_t.convert(G.type),at;G.isData3DTexture?(pe.setTexture3D(G,0),at=B.TEXTURE_3D):G.isDataArrayTexture||G.isCompressedArrayTexture?(pe.setTexture2DArray(G,0),at=B.TEXTURE_2D_ARRAY):(pe.setTexture2D(G,0),at=B.TEXTURE_2D),Z.activeTexture(B.TEXTURE0),Z.pixelStorei(B.UNPACK_FLIP_Y_WEBGL,G.flipY),Z.pixelStorei(B.UNPACK_PREMULTIPLY_ALPHA_WEBGL,G.premultiplyAlpha),Z.pixelStorei(B.UNPACK_ALIGNMENT,G.unpackAlignment);let Tt=Z.getParameter(B.UNPACK_ROW_LENGTH),Ie=Z.getParameter(B.UNPACK_IMAGE_HEIGHT),Le=Z.getParameter(B.UNPACK_SKIP_PIXELS),si=Z.getParameter(B.UNPACK_SKIP_ROWS),Xo=Z.getParameter(B.UNPACK_SKIP_IMAGES);Z.pixelStorei(B.UNPACK_ROW_LENGTH,pt.width),Z.pixelStorei(B.UNPACK_IMAGE_HEIGHT,pt.height),Z.pixelStorei(B.UNPACK_SKIP_PIXELS,Re),Z.pixelStorei(B.UNPACK_SKIP_ROWS,We),Z.pixelStorei(B.UNPACK_SKIP_IMAGES,Xe);let As=b.isDataArrayTexture||b.isData3DTexture,Mr=G.isDataArrayTexture||G.isData3DTexture;if(b.isDepthTexture){let _i=ce.get(b),Fn=ce.get(G),Li=ce.get(_i.__renderTarget),jo=ce.get(Fn.__renderTarget);Z.bindFramebuffer(B.READ_FRAMEBUFFER,Li.__webglFramebuffer),Z.bindFramebuffer(B.DRAW_FRAMEBUFFER,jo.__webglFramebuffer);for(let On=0;On<_e;On++)As&&(B.framebufferTextureLayer(B.READ_FRAMEBUFFER,B.COLOR_ATTACHMENT0,ce.get(b).__webglTexture,K,Xe+On),B.framebufferTextureLayer(B.DRAW_FRAMEBUFFER,B.COLOR_ATTACHMENT0,ce.get(G).__webglTexture,re,xt+On)),B.blitFramebuffer(Re,We,he,ge,Ee,Ye,he,ge,B.DEPTH_BUFFER_BIT,B.NEAREST);Z.bindFramebuffer(B.READ_FRAMEBUFFER,null),Z.bindFramebuffer(B.DRAW_FRAMEBUFFER,null)}else if(K!==0||b.isRenderTargetTexture||ce.has(b)){let _i=ce.get(b),Fn=ce.get(G);Z.bindFramebuffer(B.READ_FRAMEBUFFER,mf),Z.bindFramebuffer(B.DRAW_FRAMEBUFFER,gf);for(let Li=0;Li<_e;Li++)As?B.framebufferTextureLayer(B.READ_FRAMEBUFFER,B.COLOR_ATTACHMENT0,_i.__webglTexture,K,Xe+Li):B.framebufferTexture2D(B.READ_FRAMEBUFFER,B.COLOR_ATTACHMENT0,B.TEXTURE_2D,_i.__webglTexture,K),Mr?B.framebufferTextureLayer(B.DRAW_FRAMEBUFFER,B.COLOR_ATTACHMENT0,Fn.__webglTexture,re,xt+Li):B.framebufferTexture2D(B.DRAW_FRAMEBUFFER,B.COLOR_ATTACHMENT0,B.TEXTURE_2D,Fn.__webglTexture,re),K!==0?B.blitFramebuffer(Re,We,he,ge,Ee,Ye,he,ge,B.COLOR_BUFFER_BIT,B.NEAREST):Mr?B.copyTexSubImage3D(at,re,Ee,Ye,xt+Li,Re,We,he,ge):B.copyTexSubImage2D(at,re,Ee,Ye,Re,We,he,ge);Z.bindFramebuffer(B.READ_FRAMEBUFFER,null),Z.bindFramebuffer(B.DRAW_FRAMEBUFFER,null)}else Mr?b.isDataTexture||b.isData3DTexture?B.texSubImage3D(at,re,Ee,Ye,xt,he,ge,_e,st,Ge,pt.data):G.isCompressedArrayTexture?B.compressedTexSubImage3D(at,re,Ee,Ye,xt,he,ge,_e,st,pt.data):B.texSubImage3D(at,re,Ee,Ye,xt,he,ge,_e,st,Ge,pt):b.isDataTexture?B.texSubImage2D(B.TEXTURE_2D,re,Ee,Ye,he,ge,st,Ge,pt.data):b.isCompressedTexture?B.compressedTexSubImage2D(B.TEXTURE_2D,re,Ee,Ye,pt.width,pt.height,st,pt.data):B.texSubImage2D(B.TEXTURE_2D,re,Ee,Ye,he,ge,st,Ge,pt);Z.pixelStorei(B.UNPACK_ROW_LENGTH,Tt),Z.pixelStorei(B.UNPACK_IMAGE_HEIGHT,Ie),Z.pixelStorei(B.UNPACK_SKIP_PIXELS,Le),Z.pixelStorei(B.UNPACK_SKIP_ROWS,si),Z.pixelStorei(B.UNPACK_SKIP_IMAGES,Xo),re===0&&G.generateMipmaps&&B.generateMipmap(at),Z.unbindTexture()},this.initRenderTarget=function(b){ce.get(b).__webglFramebuffer===void 0&&pe.setupRenderTarget(b)},this.initTexture=function(b){b.isCubeTexture?pe.setTextureCube(b,0):b.isData3DTexture?pe.setTexture3D(b,0):b.isDataArrayTexture||b.isCompressedArrayTexture?pe.setTexture2DArray(b,0):pe.setTexture2D(b,0),Z.unbindTexture()},this.resetState=function(){j=0,z=0,k=null,Z.reset(),Gt.reset()},typeof __THREE_DEVTOOLS__<"u"&&__THREE_DEVTOOLS__.dispatchEvent(new CustomEvent("observe",{detail:this}))}get coordinateSystem(){return zi}get outputColorSpace(){return this._outputColorSpace}set outputColorSpace(e){this._outputColorSpace=e;let t=this.getContext();t.drawingBufferColorSpace=Ve._getDrawingBufferColorSpace(e),t.unpackColorSpace=Ve._getUnpackColorSpace()}};var Cp=`
precision highp float;
in vec3 corner;
uniform mat4 clip_from_source;
out vec3 source;
void main() {
  source = corner;
  gl_Position = clip_from_source * vec4(corner.xy, 1.0, corner.z);
}`,vs=`
#define SELDOM(condition) for (bool enters = (condition); enters; enters = false)
`,Mh=`
vec3 to_linear(vec3 c) {
  return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), vec3(greaterThan(c, vec3(0.04045))));
}
vec3 to_display(vec3 c) {
  return mix(12.92 * c, 1.055 * pow(max(c, vec3(1e-9)), vec3(1.0 / 2.4)) - 0.055, vec3(greaterThan(c, vec3(0.0031308))));
}`,Rp=`
uniform float gain;        // of linear light; 1: colours as they came
vec3 exposed(vec3 c) {
  SELDOM(gain != 1.0) c = to_display(min(to_linear(c) * gain, 1.0));
  return c;
}`,Ip=`
precision highp float;
precision highp int;
precision highp usampler2D;
${vs}
in vec3 source;
uniform usampler2D depth;   // codes of 1/z; 65535 where there is no sample
uniform usampler2D joined;  // which of the four texels around each corner are of one surface
uniform sampler2D color;
uniform float code_scale;  // 1/z of code 1
uniform float enhance;     // how much shape is made easier to read; 0: colours as they came
uniform bool parted;        // what mirrors show apart from the rest
uniform sampler2D shown;    // what mirrors show, a part of the colours
uniform usampler2D behind;  // codes of it: 65535 where nothing mirrors
uniform bool trim;         // leave out what lies beside something nearer: smooth outlines and JPEG mix the colours of both
layout(location = 0) out vec4 picture;  // display colour; a > 0 tells that the pixel is covered, and how near it is
layout(location = 1) out vec4 painted;  // what mirrors show, a part of the light; a > 0 where a mirror is seen

const float RIP = 0.12;      // share of 1/z by which a fragment may differ from its texel
const float NEARER = 0.02;   // share of 1/z by which a texel of another surface must be nearer to spoil colours
const float OCTAVES = 12.0;
const float BREAK = 0.03;    // share of 1/z between texels beyond which they are of different surfaces
const float STRETCHED = 3.0; // pixels of the view across one of the picture, from which on it is drawn out
const float GAIN = 45.0;     // bend, as a share of 1/z, that counts by half: 1 / GAIN

// Whether one pixel of the picture is drawn over many of the view, as where a surface is seen from its side that was
// seen at a grazing angle: the least pixels of the picture per pixel of the view, over all directions.
bool drawn_out() {
  vec2 across = dFdx(source.xy);
  vec2 down = dFdy(source.xy);
  float sum = dot(across, across) + dot(down, down);
  float area = across.x * down.y - across.y * down.x;
  float least = 0.5 * (sum - sqrt(max(sum * sum - 4.0 * area * area, 0.0)));
  return least * STRETCHED * STRETCHED < 1.0;
}

float at(ivec2 p) {
  uint code = texelFetch(depth, p, 0).r;
  return code == 65535u ? -1.0 : float(code) * code_scale;
}

// Whether another surface, with 1/z beyond a limit, is in one of the eight texels around one.
bool beside_nearer(ivec2 own, float limit, ivec2 last) {
  for (int k = 0; k < 4; k++) {
    ivec2 corner = own + ivec2(k & 1, k >> 1);
    uint word = texelFetch(joined, corner, 0).r;
    uint label = (word >> (2 * (3 - k))) & 3u;
    for (int m = 0; m < 4; m++) {
      ivec2 p = clamp(corner - 1 + ivec2(m & 1, m >> 1), ivec2(0), last);
      if (((word >> (2 * m)) & 3u) != label && at(p) > limit) return true;
    }
  }
  return false;
}

${Mh}
${Rp}
// The two parts of a colour, \`all\` becomes the rest: what mirrors show may not be brighter than all. White hides how
// bright it is: where what is mirrored does not make it so, something else does, and stays.
vec3 mirrored_part(inout vec3 all, vec3 mirrored) {
  vec3 light = min(to_linear(mirrored), to_linear(all));
  vec3 rest = to_display(to_linear(all) - light);
  all = mix(rest, all, vec3(greaterThan(all, vec3(0.998))) * vec3(lessThan(light, vec3(1.0))));
  return to_display(light);
}

vec3 color_at(ivec2 p) {
  return texelFetch(color, p, 0).rgb;
}

// How a surface bends around a texel, in [-1, 1]; ridges are positive. 1/z of a plane changes evenly over the picture,
// so that what is left of it beside two texels that face each other is bend.
float shape(ivec2 p, float z, ivec2 last) {
  float bend = 0.0;
  float pairs = 0.0;
  for (int k = 0; k < 12; k++) {
    float angle = 0.78539816 * float(k) / 3.0;
    ivec2 way = ivec2(round(vec2(cos(angle), sin(angle)) * float(1 + k % 3)));
    ivec2 a = p + way;
    ivec2 b = p - way;
    if (any(lessThan(min(a, b), ivec2(0))) || any(greaterThan(max(a, b), last))) continue;
    float before = at(a);
    float after = at(b);
    if (before < 0.0 || after < 0.0 || abs(2.0 * z - before - after) > BREAK * z) continue;
    bend += 2.0 * z - before - after;
    pairs += 1.0;
  }
  if (pairs == 0.0) return 0.0;
  float share = GAIN * bend / (pairs * z);
  return share / (1.0 + abs(share));
}

void main() {
  bool stretched = drawn_out(); // before anything is discarded: it looks at the pixels beside
  ivec2 last = textureSize(depth, 0) - 1;
  float z = source.z;
  float step = 2.0 * code_scale;
  vec2 place = source.xy - 0.5;
  vec2 t = fract(place);
  ivec2 low = ivec2(floor(place));
  ivec2 p0 = clamp(low, ivec2(0), last);
  ivec2 p3 = clamp(low + 1, ivec2(0), last);
  ivec2 p1 = ivec2(p3.x, p0.y);
  ivec2 p2 = ivec2(p0.x, p3.y);
  ivec2 own = t.y < 0.5 ? (t.x < 0.5 ? p0 : p1) : (t.x < 0.5 ? p2 : p3);
  float near = at(own);
  if (near < 0.0 || abs(near - z) > RIP * max(near, z) + step) discard;
  uint word = texelFetch(joined, clamp(low + 1, ivec2(0), last + 1), 0).r;
  uint label = (word >> (2u * ((t.x < 0.5 ? 0u : 1u) + (t.y < 0.5 ? 0u : 2u)))) & 3u;
  uvec4 labels = (uvec4(word) >> uvec4(0u, 2u, 4u, 6u)) & 3u;
  vec4 alike = vec4(equal(labels, uvec4(label)));
  bool spoilt = false;
  SELDOM(trim) spoilt = beside_nearer(own, (1.0 + NEARER) * near + step, last);
  if (spoilt) discard;
  bool mirrors = parted && texelFetch(behind, own, 0).r != 65535u;
  bool whole = alike == vec4(1.0);
  vec3 c = textureLod(color, source.xy / vec2(last + 1), 0.0).rgb;
  vec3 m = vec3(0.0);
  SELDOM(mirrors) m = (whole ? textureLod(shown, source.xy / vec2(last + 1), 0.0) : texelFetch(shown, own, 0)).rgb;
  SELDOM(!whole) {
    vec4 weight = vec4(1.0 - t.x, t.x, 1.0 - t.x, t.x) * vec4(1.0 - t.y, 1.0 - t.y, t.y, t.y) * alike;
    weight /= dot(weight, vec4(1.0));
    c = weight.x * color_at(p0) + weight.y * color_at(p1) + weight.z * color_at(p2) + weight.w * color_at(p3);
  }
  painted = vec4(0.0);
  SELDOM(mirrors) painted = vec4(exposed(mirrored_part(c, m)), 1.0);
  SELDOM(enhance != 0.0 && near > 0.0) c = clamp(c * (1.0 + enhance * shape(own, near, last)), 0.0, 1.0);
  c = exposed(c);
  // The buffer holds 1 - near / depth; steps of 7 % of the depth tell well enough what lies behind what. The lowest bit
  // tells pixels that are drawn out.
  float key = clamp(1.0 + log2(max(1.0 - gl_FragCoord.z, 1e-9)) / OCTAVES, 0.0, 1.0);
  picture = vec4(c, (1.0 + 2.0 * floor(126.0 * key + 0.5) + (stretched ? 1.0 : 0.0)) / 255.0);
}`,Pp=`
precision highp float;
in vec3 position;
void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }`,Lp=`
precision highp float;
precision highp int;
uniform sampler2D color;
uniform vec4 place;  // where the lower left corner of the view lies in the picture, and one pixel of the view
layout(location = 0) out vec4 picture;
${vs}
${Mh}
${Rp}
void main() {
  vec2 p = place.xy + place.zw * gl_FragCoord.xy;
  picture = vec4(exposed(textureLod(color, p / vec2(textureSize(color, 0)), 0.0).rgb), 1.0);
}`,Up=`
precision highp float;
uniform sampler2D warped;   // the rest of the light
uniform sampler2D painted;  // what mirrors showed; a > 0 where a mirror is seen
uniform sampler2D beyond;   // what lies behind the mirrors, seen as if they were windows
layout(location = 0) out vec4 picture;
${vs}
${Mh}
void main() {
  ivec2 own = ivec2(gl_FragCoord.xy);
  vec4 rest = texelFetch(warped, own, 0);
  vec4 paint = texelFetch(painted, own, 0);
  SELDOM(paint.a > 0.0) {
    vec4 through = texelFetch(beyond, own, 0);
    vec3 light = through.a > 0.0 && through.a <= rest.a + 0.005 ? through.rgb : paint.rgb;
    rest.rgb = to_display(min(to_linear(rest.rgb) + to_linear(light), 1.0));
  }
  picture = rest;
}`,Sh=`
const float BEHIND = 0.02;  // a quarter of an octave of depth
float behind(float key, float farthest, float preference) {
  return exp2(-preference * max(key - farthest - BEHIND, 0.0)) + 0.01;
}

// A level of the pyramid between its cells, the farther ones preferred; \`place\` in its pixels.
vec4 between(sampler2D level, vec2 place, float preference) {
  ivec2 last = textureSize(level, 0) - 1;
  ivec2 low = ivec2(floor(place - 0.5));
  vec2 share = clamp(place - 0.5 - vec2(low), 0.001, 0.999);
  vec4 cells[4];
  float farthest = 2.0;
  for (int k = 0; k < 4; k++) {
    cells[k] = texelFetch(level, clamp(low + ivec2(k & 1, k >> 1), ivec2(0), last), 0);
    if (cells[k].a > 0.0) farthest = min(farthest, cells[k].a);
  }
  vec4 sum = vec4(0.0);
  float weights = 0.0;
  for (int k = 0; k < 4; k++) {
    if (cells[k].a == 0.0) continue;
    float weight = ((k & 1) == 1 ? share.x : 1.0 - share.x) * (k > 1 ? share.y : 1.0 - share.y);
    weight *= behind(cells[k].a, farthest, preference);
    sum += weight * cells[k];
    weights += weight;
  }
  return weights > 0.0 ? sum / weights : vec4(0.0);
}`,Dp=`
precision highp float;
precision highp int;
uniform sampler2D finer;     // colours and keys
uniform sampler2D coverage;  // roots of the shares that are covered
uniform bool weighted;       // there are such shares; otherwise keys tell what is covered
uniform int cell;            // of its pixels along a side
uniform float preference;
layout(location = 0) out vec4 mean;
layout(location = 1) out vec4 covered;

${Sh}
void main() {
  ivec2 first = ivec2(gl_FragCoord.xy) * cell;
  ivec2 end = min(first + cell, textureSize(finer, 0));
  float farthest = 2.0;
  float nearest = 0.0;
  vec4 sum = vec4(0.0);
  for (int y = first.y; y < end.y; y++)
    for (int x = first.x; x < end.x; x++) {
      vec4 texel = texelFetch(finer, ivec2(x, y), 0);
      farthest = min(farthest, texel.a);
      nearest = max(nearest, texel.a);
      sum += texel;
    }
  ivec2 size = end - first;
  if (!weighted && farthest > 0.0 && nearest <= farthest + BEHIND) { // as most are: all is covered, by one surface
    mean = sum / float(size.x * size.y);
    covered = vec4(1.0);
    return;
  }
  farthest = 2.0;
  for (int y = first.y; y < end.y; y++)
    for (int x = first.x; x < end.x; x++) {
      float key = texelFetch(finer, ivec2(x, y), 0).a;
      if (key > 0.0) farthest = min(farthest, key);
    }
  sum = vec4(0.0);
  float weights = 0.0;
  float shares = 0.0;
  for (int y = first.y; y < end.y; y++)
    for (int x = first.x; x < end.x; x++) {
      vec4 texel = texelFetch(finer, ivec2(x, y), 0);
      if (texel.a == 0.0) continue;
      float root = weighted ? texelFetch(coverage, ivec2(x, y), 0).r : 1.0;
      float weight = root * root * behind(texel.a, farthest, preference);
      sum += weight * texel;
      weights += weight;
      shares += root * root;
    }
  mean = weights > 0.0 ? sum / weights : vec4(0.0);
  covered = vec4(weights > 0.0 ? max(sqrt(shares / float(size.x * size.y)), 1.0 / 255.0) : 0.0);
}`,Np=`
precision highp float;
precision highp int;
uniform sampler2D own;
uniform sampler2D coverage;
uniform sampler2D coarser;
uniform float preference;
layout(location = 0) out vec4 filled;
${vs}
const float ENOUGH = 0.75;  // a share that is covered from which on nothing else counts
${Sh}
void main() {
  ivec2 p = ivec2(gl_FragCoord.xy);
  vec4 mean = texelFetch(own, p, 0);
  float root = texelFetch(coverage, p, 0).r;
  float share = min(root * root / ENOUGH, 1.0);
  filled = mean;
  SELDOM(share < 1.0) {
    vec4 around = between(coarser, 0.5 * gl_FragCoord.xy, preference);
    float farthest = mean.a > 0.0 ? min(mean.a, around.a) : around.a;
    float within = share * behind(mean.a, farthest, preference);
    float beside = (1.0 - share) * behind(around.a, farthest, preference);
    filled = mix(around, mean, within / (within + beside));
  }
}`,Fp=`
precision highp float;
precision highp int;
uniform sampler2D warped;
uniform sampler2D around;  // of the pyramid, its finest level
uniform int cell;          // pixels along a side of its cells
uniform float preference;
uniform vec3 backdrop;
uniform int radius;  // 0: holes stay
uniform bool mark;   // alpha 0 in holes, for captures
uniform sampler2D before;  // what was shown until now
uniform float fade;  // of the new picture; 1: nothing else
layout(location = 0) out vec4 shown;
${vs}
const int DIRECTIONS = 12;
// Directions in which something is found: fewer make a hole an open one, which the pyramid fills alone; a small one has more.
const float OPEN = 4.0;
const float ENCLOSED = 9.0;

${Sh}
// The colour of a hole.
vec3 filled(ivec2 own) {
  ivec2 last = textureSize(warped, 0) - 1;
  vec4 found[DIRECTIONS];
  float distances[DIRECTIONS];
  float farthest = 2.0;
  for (int k = 0; k < DIRECTIONS; k++) {
    float angle = 6.2831853 * (float(k) + 0.25) / float(DIRECTIONS);
    vec2 way = vec2(cos(angle), sin(angle));
    found[k] = vec4(0.0);
    for (int r = 1; r <= radius; r++) {
      ivec2 p = own + ivec2(round(way * float(r)));
      if (any(lessThan(p, ivec2(0))) || any(greaterThan(p, last))) break;
      vec4 other = texelFetch(warped, p, 0);
      if (other.a > 0.0) {
        found[k] = other;
        distances[k] = float(r);
        farthest = min(farthest, other.a);
        break;
      }
    }
  }
  vec3 sum = vec3(0.0);
  float weights = 0.0;
  float nearest = float(radius) + 1.0;
  float enclosing = 0.0;
  for (int k = 0; k < DIRECTIONS; k++) {
    if (found[k].a == 0.0) continue;
    float weight = (found[k].a <= farthest + BEHIND ? 1.0 : 0.01) / (distances[k] * distances[k]);
    sum += weight * found[k].rgb;
    weights += weight;
    nearest = min(nearest, distances[k]);
    enclosing += 1.0;
  }
  float trust = weights > 0.0 ? 1.0 - smoothstep(0.5, 1.0, (nearest - 1.0) / float(radius)) : 0.0;
  if (trust == 1.0 && enclosing >= ENCLOSED) return sum / weights;
  vec4 wide = between(around, gl_FragCoord.xy / float(cell), preference);
  if (wide.a == 0.0) wide.rgb = backdrop;
  else if (enclosing < ENCLOSED) trust *= smoothstep(OPEN, ENCLOSED, enclosing) * min(behind(farthest, wide.a, preference), 1.0);
  return mix(wide.rgb, sum / max(weights, 1e-6), trust);
}

void main() {
  ivec2 own = ivec2(gl_FragCoord.xy);
  vec4 texel = texelFetch(warped, own, 0);
  bool hole = texel.a == 0.0;
  shown = hole ? vec4(backdrop, mark ? 0.0 : 1.0) : vec4(texel.rgb, 1.0);
  SELDOM(!hole && fade < 1.0) {
    vec4 old = texelFetch(before, own, 0);
    if (old.a > 0.0) shown.rgb = mix(old.rgb, texel.rgb, fade);
  }
  SELDOM(hole && radius > 0) shown.rgb = filled(own);
}`,Op=`
precision highp float;
precision highp int;
uniform sampler2D warped;
layout(location = 0) out vec4 count;

const int TILE = 16;

void main() {
  ivec2 first = ivec2(gl_FragCoord.xy) * TILE;
  ivec2 size = textureSize(warped, 0);
  int covered = 0;
  int stretched = 0;
  for (int y = 0; y < TILE; y++)
    for (int x = 0; x < TILE; x++) {
      ivec2 p = first + ivec2(x, y);
      int key = all(lessThan(p, size)) ? int(texelFetch(warped, p, 0).a * 255.0 + 0.5) : 0;
      if (key > 0) covered++;
      if (key > 0 && (key & 1) == 0) stretched++;
    }
  count = vec4(float(covered & 255), float(covered >> 8), float(stretched & 255), float(stretched >> 8)) / 255.0;
}`,bh=16;var _s=4,Bp=2,xs=24,B0=2,k0=3,kp=r=>xs*Math.min(1,k0**(B0-r)),Po=class{constructor(e,t){this.buffer=t,this.pull=e(Dp,{finer:{value:null},coverage:{value:null},cell:{value:_s},preference:{value:xs},weighted:{value:!1}}),this.push=e(Np,{own:{value:null},coverage:{value:null},coarser:{value:null},preference:{value:xs}}),this.levels=[]}get passes(){return[this.pull,this.push]}resize(e,t){for(let{pulled:i,filled:n}of this.levels)i.dispose(),n?.dispose();this.levels=[];for(let i=_s;;i=Bp){e=Math.ceil(e/i),t=Math.ceil(t/i);let n=e===1&&t===1;if(this.levels.push({pulled:this.buffer(e,t,2),filled:n?null:this.buffer(e,t,1)}),n)return}}build(e,t){let{levels:i}=this,n=this.pull.uniforms;i.forEach(({pulled:o},l)=>{let[c,h]=l?i[l-1].pulled.textures:[e,e];n.finer.value=c,n.coverage.value=h,n.cell.value=l?Bp:_s,n.weighted.value=l>0,n.preference.value=kp(l),t(this.pull,o)});let s=this.push.uniforms,a=i.at(-1).pulled.textures[0];for(let o=i.length-2;o>=0;o--){let{pulled:l,filled:c}=i[o];[s.own.value,s.coverage.value]=l.textures,s.coarser.value=a,s.preference.value=kp(o),t(this.push,c),a=c.texture}return a}};var zp=8,z0=[.055,.063,.078],G0=.004,V0=.01,H0=.001,W0=.05,X0=.9,wh=.02,Gp=(r,e,t,i)=>new hr({glslVersion:ds,vertexShader:r,fragmentShader:e,uniforms:t,blending:ri,depthTest:i,depthWrite:i}),Th=(r,e)=>(r.colorSpace=Ri,r.minFilter=e,r.magFilter=e,r.wrapS=di,r.wrapT=di,r.generateMipmaps=!1,r.flipY=!1,r.unpackAlignment=2,r.needsUpdate=!0,r);function j0({camera:r,nearest:e,whole:t},i){if(!t||!(Qh(i,r,e)<wh))return!1;let{left:n,across:s,top:a,down:o}=Jo(i,r),l=(c,h,u,f)=>c>-wh&&c+h*u<f+wh;return l(n,s,i.width,r.width)&&l(a,o,i.height,r.height)}function Vp(r){let e=new Uint32Array(6*r);for(let t=0;t<r;t++)e.set([4*t,4*t+1,4*t+2,4*t,4*t+2,4*t+3],6*t);return new Et(e,1)}var Lo=class{constructor(e){this.renderer=new Ro({canvas:e,antialias:!1,alpha:!1,depth:!1,stencil:!1}),this.renderer.debug.checkShaderErrors=!1,this.renderer.autoClear=!1,this.renderer.sortObjects=!1,this.renderer.setClearColor(0,0),this.camera=new sn,this.scene=new ar,this.scene.matrixWorldAutoUpdate=!1,this.index=Vp(16384),this.pictures=new Set,this.waiting=[],this.prepared=null,this.target=null;let t=new Je;t.setAttribute("position",new Et(new Float32Array([-1,-1,0,3,-1,0,-1,3,0]),3)),this.fill=this.pass(t,Fp,{warped:{value:null},around:{value:null},cell:{value:_s},preference:{value:xs},backdrop:{value:new A(...z0)},radius:{value:zp},mark:{value:!1},before:{value:null},fade:{value:1}}),this.pyramid=new Po((i,n)=>this.pass(t,i,n),(i,n,s)=>this.buffer(i,n,!1,s)),this.joint=this.pass(t,Up,{warped:{value:null},painted:{value:null},beyond:{value:null}}),this.mirrorBuffers=null,this.whole=!1,this.drawn=!0,this.direct=this.pass(t,Lp,{color:{value:null},place:{value:new $e},gain:{value:1}}),this.count=this.pass(t,Op,{warped:{value:null}}),this.counting=!1}async prepare(){if(this.prepared)return;let e=await createImageBitmap(new ImageData(1,1)),t={data:new Float32Array(12),count:1,joined:new Uint8Array(4)},i={camera:{width:1,height:1},depth:{near:1},layer:0};this.prepared=this.add({header:i,codes:new Uint16Array(1),scale:1,quads:t,color:e});let n=[this.direct,this.fill,this.count,...this.pyramid.passes].map(({scene:s})=>s);for(let s of[this.prepared.mesh,...n])this.renderer.compile(s,this.camera)}pass(e,t,i){let n=new ar,s=new Ct(e,Gp(Pp,t,i,!1));return s.frustumCulled=!1,n.add(s),{scene:n,uniforms:i}}get context(){return this.renderer.getContext()}resize(e,t){if(!(this.target?.width===e&&this.target.height===t)){this.renderer.setPixelRatio(1),this.renderer.setSize(e,t,!1),this.target?.dispose(),this.target=this.buffer(e,t,!0),this.shown=this.target;for(let i of Object.values(this.put??{}))i?.dispose();this.put=null;for(let i of Object.values(this.mirrorBuffers??{}))i.dispose();this.mirrorBuffers=null,this.pyramid.resize(e,t),this.counts?.dispose(),this.counts=this.buffer(Math.ceil(e/bh),Math.ceil(t/bh),!1)}}buffer(e,t,i,n=1){return new kt(e,t,{count:n,format:Jt,type:zt,colorSpace:Ri,minFilter:At,magFilter:At,depthBuffer:i,stencilBuffer:!1,generateMipmaps:!1})}add(e){let{width:t,height:i}=e.header.camera,n=Th(new bn(e.codes,t,i,In,an),At);n.internalFormat="R16UI";let s=new bn(e.quads.joined,t+1,i+1,In,zt),a=Th(s,At);a.internalFormat="R8UI",a.unpackAlignment=1;let o=Th(new Dt(e.color),wt),l={clip_from_source:{value:null},depth:{value:n},joined:{value:a},color:{value:o},code_scale:{value:e.scale},enhance:{value:0},trim:{value:!1},parted:{value:!1},gain:{value:1},shown:{value:o},behind:{value:n}},c=new Je;c.setAttribute("corner",new Et(e.quads.data,3));let h=new Ct(c,Gp(Cp,Ip,l,!0));h.frustumCulled=!1,h.matrixAutoUpdate=!1,6*e.quads.count>this.index.count&&this.growIndex(e.quads.count),c.setIndex(this.index),c.setDrawRange(0,6*e.quads.count);let{camera:u,layer:f,depth:{near:p},mask:g}=e.header,{exposure:d=0,tone_map:_="none"}=e.header,m={exposure:d,linear:_==="none"},v={camera:u,extra:f>0,shown:m,mesh:h,uniforms:l,quads:e.quads.count,bitmap:e.color,mirrors:null};return Object.assign(v,{nearest:p,whole:f===0&&!g}),this.pictures.add(v),this.renderer.initTexture(o),this.waiting.push(n,a),v}uploadNext(){let e=this.waiting.shift();e&&this.renderer.initTexture(e)}addMirrors(e,t){e.mirrors&&this.remove(e.mirrors),e.mirrors=t,e.uniforms.shown.value=t.uniforms.color.value,e.uniforms.behind.value=t.uniforms.depth.value}growIndex(e){let t=this.index;this.index=Vp(Math.ceil(1.25*e));for(let n of this.pictures)n.mesh.geometry.setIndex(this.index);let i=new Je;i.setIndex(t),i.dispose()}remove(e){this.pictures.delete(e),e.mirrors&&this.remove(e.mirrors);let{mesh:t,uniforms:i}=e;t.geometry.setIndex(null),t.geometry.dispose(),t.material.dispose(),this.waiting=this.waiting.filter(n=>n!==i.depth.value&&n!==i.joined.value),i.depth.value.dispose(),i.joined.value.dispose(),i.color.value.dispose(),e.bitmap.close()}warp(e,t,i,{enhance:n=0,mirrors:s=!0,exposure:a=null,direct:o=!0}={}){this.scene.clear();let l=e[0]??null;if(this.whole=o&&!n&&l!==null&&j0(l,t),this.drawn=!0,this.whole)return this.show(l,t,a);let h=(l?yt(Ot(mt(l.camera),mt(t))):0)<W0*i,u=h?X0:0;e.forEach((d,_)=>{let m=_===0?0:Math.max(u,d.extra?V0:G0)+_*H0;d.uniforms.enhance.value=n,this.expose(d,a),d.uniforms.trim.value=_>0&&!d.extra,d.uniforms.clip_from_source.value=$o(d.camera,t,i,m)});for(let d of[...e].reverse())this.scene.add(d.mesh);this.shown=this.target;let f=s&&!h&&!!l?.mirrors;if(e.forEach((d,_)=>d.uniforms.parted.value=f&&_===0),!f)return this.drawScene(this.target);let p=this.makeMirrorBuffers();this.drawScene(p.parts),this.scene.clear(),this.scene.add(l.mirrors.mesh),l.mirrors.uniforms.clip_from_source.value=$o(l.mirrors.camera,t,i,0),this.drawScene(p.beyond);let{uniforms:g}=this.joint;[g.warped.value,g.painted.value]=p.parts.textures,g.beyond.value=p.beyond.texture,this.run(this.joint,p.joint),this.shown=p.joint}show(e,t,i){this.expose(e,i);let{left:n,across:s,top:a,down:o}=Jo(t,e.camera),{uniforms:l}=this.direct;l.place.value.set(n,a+o*t.height,s,-o),l.color.value=e.uniforms.color.value,l.gain.value=e.uniforms.gain.value,this.shown=this.target,this.drawn=!1}complete(){this.drawn||this.run(this.direct,this.target),this.drawn=!0}expose(e,t){let i=t===null||!e.shown.linear?1:2**(t-e.shown.exposure);e.uniforms.gain.value=Math.abs(i-1)<1e-6?1:i,e.mirrors&&(e.mirrors.uniforms.gain.value=e.uniforms.gain.value)}drawScene(e){this.renderer.setRenderTarget(e),this.renderer.clear(!0,!0,!1),this.renderer.render(this.scene,this.camera)}makeMirrorBuffers(){let{width:e,height:t}=this.target;return this.mirrorBuffers??={parts:this.buffer(e,t,!0,2),beyond:this.buffer(e,t,!0),joint:this.buffer(e,t,!1)},this.mirrorBuffers}putAside(){this.complete();let{width:e,height:t}=this.target,i=this.mirrorBuffers?.joint,n=this.shown;return this.put??={target:this.buffer(e,t,!0),joint:null},[this.target,this.put.target]=[this.put.target,this.target],i&&(this.put.joint??=this.buffer(e,t,!1),[this.mirrorBuffers.joint,this.put.joint]=[this.put.joint,i]),n}present({fill:e=!0,mark:t=!1,target:i=null,before:n=null,fade:s=1}={}){if(this.whole&&!n)return this.run(this.direct,i);this.complete(),this.fill.uniforms.warped.value=this.shown.texture,this.fill.uniforms.before.value=(n??this.shown).texture,this.fill.uniforms.fade.value=n?s:1,this.fill.uniforms.radius.value=e?zp:0,this.fill.uniforms.mark.value=t,e&&!this.whole&&(this.fill.uniforms.around.value=this.pyramid.build(this.shown.texture,this.run)),this.run(this.fill,i)}run=({scene:e},t)=>{this.renderer.setRenderTarget(t),this.renderer.render(e,this.camera)};drawCounts(){this.count.uniforms.warped.value=this.shown.texture,this.run(this.count,this.counts)}async holeShare(){if(this.whole)return{holes:0,stretched:0};if(this.counting||!this.target)return null;this.counting=!0;try{let{width:e,height:t}=this.counts,i=this.target.width*this.target.height,n=new Uint8Array(4*e*t);this.drawCounts(),await this.renderer.readRenderTargetPixelsAsync(this.counts,0,0,e,t,n);let s=0,a=0;for(let o=0;o<n.length;o+=4)s+=n[o]+256*n[o+1],a+=n[o+2]+256*n[o+3];return{holes:1-s/i,stretched:a/i}}finally{this.counting=!1}}capture(e){let{width:t,height:i}=this.target,n=this.buffer(t,i,!1);this.present({fill:e,mark:!0,target:n});let s=new Uint8Array(4*t*i);this.read(n,t,i,s),n.dispose();let a=new Uint8Array(s.length);for(let o=0;o<i;o++)a.set(s.subarray(4*t*o,4*t*(o+1)),4*t*(i-1-o));return a}finish(){this.complete(),this.read(this.shown,1,1,new Uint8Array(4))}read(e,t,i,n){let s=this.context;s.bindBuffer(s.PIXEL_PACK_BUFFER,null),this.renderer.readRenderTargetPixels(e,0,0,t,i,n)}};var q0=50,Y0=250,Z0=250,K0=.12,$0=.004,J0=.1,Q0=140,ev=50,tv=.002,iv=.1,nv=(r,e)=>r!==null&&e!==null&&r.near===e.near&&r.world_from_camera.every((t,i)=>t===e.world_from_camera[i]),Uo=class{constructor(e,t,i){this.canvas=e,this.walker=t,this.hooks=i,this.warp=null,this.keyframes=new Us,this.decoder=new Ps,this.stream=new Gs({state:(n,s)=>this.onState(n,s),welcome:(n,s)=>this.onWelcome(n,s),keyframe:n=>this.onKeyframe(n),problem:n=>this.hooks.refused(n),told:(n,s)=>this.onTold(n,s)}),this.health=new Ls(this),this.ev=null,this.picks=0,this.state="closed",this.lost=!1,this.acks=[],this.moving=!1,this.pose={seq:0,sent:0,camera:null,moving:!1},this.traffic=new Ds,this.figures={frame:new Gn,warp:new Gn,decode:new Gn,latency:new Ns},this.counts={keyframes:0,images:0,frames:0,drawn:0,errors:0,resyncs:0},this.holes=null,this.stretched=null,this.holesAt=0,this.figuresAt=0,this.holesOf=0,this.views=0,this.dirty=!0,this.settings=null,this.seq=0,this.drawn=[],this.fade=null,this.calm=window.matchMedia?.("(prefers-reduced-motion: reduce)").matches,this.picked=null,this.ended=null,e.addEventListener("webglcontextlost",()=>this.onContext(!0)),e.addEventListener("webglcontextrestored",()=>this.onContext(!1)),requestAnimationFrame(n=>this.frame(n))}start(e,t,i=null){this.wishes=e,this.acks=[],this.ended?.scene!==e.scene&&(this.forget(),this.walker.camera=null,this.ev=null),this.stream.start(e,t,i)}forget(){this.fade=null,this.drawn=[],this.holes=this.stretched=null,this.views++,this.keyframes.clear()}wish(e,t){this.settings=e;let{budget_ms:i,max_error:n,layers:s}=e;this.wishes&&Object.assign(this.wishes,{budget_ms:i,max_error:n,layers:s}),this.keyframes.outdate(),this.health.expect(++this.seq,t),this.stream.send(ut.SETTINGS,{...e,seq:this.seq})}pick(e,t){let i=this.walker.camera;if(!i)return;let n=e*i.width/this.canvas.clientWidth,s=t*i.height/this.canvas.clientHeight;n<0||s<0||n>=i.width||s>=i.height||this.stream.send(ut.PICK,{seq:++this.picks,camera:i,x:n,y:s})}onTold(e,t){e===ut.STATUS?this.health.hear(t):e===ut.PICKED&&t.seq===this.picks?this.hooks.picked(t):e===ut.LOOK&&this.walker.camera&&(t.camera.near!==this.walker.camera.near&&(this.keyframes.cut=t.camera.near),this.walker.jumpTo(t.camera),this.dirty=!0,this.hooks.moved())}onState(e,t){this.state=e,this.hooks.state(e,t)}onWelcome(e,t){let{camera:i}=e;this.diagonal=e.scene.diagonal??t.scene_diagonal;let n=this.ended?.scene===this.wishes.scene&&this.walker.camera;if(!n)this.forget(),this.walker.place(i,t.up,this.diagonal,{bounds:e.scene.bounds,mode:e.scene.controls});else{let{world_from_camera:s,near:a}=this.walker.camera;this.walker.home=i,this.walker.camera={...i,world_from_camera:s,near:a}}this.keyframes.home=this.walker.home,this.ended={scene:this.wishes.scene},this.hooks.scene(e.scene,!n),this.acks=[],this.pose.camera=null,this.settings&&this.stream.send(ut.SETTINGS,{...this.settings,seq:++this.seq}),this.sendPose(),this.warp?.resize(i.width,i.height),this.dirty=!0}async onKeyframe(e){let t=this.stream.socket;this.traffic.add(e.byteLength);let i;try{let a=this.decoder.decode(e,fl);this.warp||this.makeWarp(),i=await a}catch(a){if(this.counts.errors++,console.warn(`keyframe refused: ${a.message}`),t!==this.stream.socket)return;this.counts.resyncs++,this.stream.send(ut.RESYNC,{last:this.keyframes.newest?.id??null});return}if(t!==this.stream.socket||!this.warp)return i.color.close();this.counts.images++,this.figures.decode.add(i.times.all);let n=this.keyframes.newest?.header,s=this.keyframes.add(i);this.fadeOut(n,s?.header),s&&(s.bytes=i.bytes,s.decode_ms=i.times.all,this.acks.push(s),this.counts.keyframes++,this.health.arrived(i.header),this.hooks.keyframe(i.header)),this.dirty=!0}makeWarp(){try{this.warp=this.keyframes.warp=new Lo(this.canvas)}catch(i){this.stream.stop(),this.hooks.unable(i);return}let{width:e,height:t}=this.walker.camera;this.warp.resize(e,t),this.warp.prepare()}onContext(e){this.lost=e,this.dirty=!0,this.hooks.context(e)}frame(e){requestAnimationFrame(s=>this.frame(s));let t=Math.min(100,e-(this.before??e));this.before=e,t>0&&(this.figures.frame.add(t),this.hooks.frame(t)),this.counts.frames++,this.moving=this.walker.step(t/1e3),this.moving&&this.hooks.moved();let i=this.easeExposure(t/1e3),n=(this.moving||this.dirty||i||this.fade)&&!this.lost;n?this.draw():this.lost||this.warp?.uploadNext(),(!n||this.moving)&&this.measureHoles(e),this.sendPose(),!(e-this.figuresAt<Z0)&&(this.figuresAt=e,this.hooks.figures(this.stats))}easeExposure(e){let t=this.keyframes.newest?.header;if(!t)return!1;let i=this.hooks.exposure(),n=i??t.exposure??0,s=this.ev,a=s===null||i!==null||Math.abs(n-s)<$0;return this.ev=a?n:s+(n-s)*(1-Math.exp(-e/K0)),this.ev!==s}draw(){let e=this.walker.camera;if(!e||!this.keyframes.newest)return;let t=performance.now(),i={...this.hooks.sources(),most:this.slow?1:void 0},n={...i,exposure:this.ev},s=this.fade?(t-this.fade.since)/Q0:1;s>=1&&(this.fade=null);let a=null;this.fade&&(this.warp.warp(this.fade.pictures,e,this.near,n),a=this.warp.putAside()),this.drawn=this.keyframes.pictures(e,i),this.warp.warp(this.drawn,e,this.near,n),this.warp.present({fill:i.fill,before:a,fade:s}),this.keyframes.sweep(this.fade?.pictures),this.figures.warp.add(performance.now()-t),this.dirty=!1,this.counts.drawn++,this.acknowledge()}get slow(){return this.moving&&this.figures.frame.value>ev}fadeOut(e,t){if(!e||!t||this.calm||this.slow||!this.drawn.length)return;let i=n=>(e[n]??0)===(t[n]??0);!i("scene_s")||!i("revision")||(this.fade={pictures:this.drawn,since:performance.now()})}measureHoles(e){if(this.lost||!this.drawn.length||this.holesOf===this.counts.drawn||e-this.holesAt<Y0)return;this.holesAt=e;let{views:t,counts:{drawn:i}}=this,n=s=>{!s||t!==this.views||(Object.assign(this,s),this.holesOf=i)};this.warp.holeShare().then(n,()=>{})}get near(){let e=this.keyframes.newest?.header.depth.near??1/0;return Math.min(tv*this.diagonal,Math.max(this.walker.camera.near,iv*e))}acknowledge(){let e=performance.now();for(let t of this.acks.splice(0)){let{header:i}=t;i.pose>=0&&!i.still&&this.figures.latency.add(e-i.time_ms);let n=Math.min(1,Math.max(0,this.holes??0));this.stream.send(ut.ACK,{id:t.id,decode_ms:t.decode_ms,shown_ms:e,holes:n})}}sendPose(){let e=performance.now(),t=this.moving,i=this.walker.camera;if(this.state!=="live"||!i||e-this.pose.sent<q0||nv(i,this.pose.camera)&&this.pose.moving===t)return;let{spin:n}=this.walker,s=this.walker.foreseen(Math.max(J0,(this.figures.latency.value??0)/1e3)),a={seq:++this.pose.seq,time_ms:e,camera:i,velocity:s,spin:n,moving:t};t||Object.assign(a,{velocity:[0,0,0],spin:[0,0,0]}),this.stream.send(ut.POSE,a,{droppable:!0})&&(this.pose={...this.pose,sent:e,camera:i,moving:t})}get stats(){let{frame:e,warp:t,decode:i,latency:n}=this.figures,s=this.walker.camera,a=s?this.keyframes.pictures(s,this.hooks.sources()):[];return{...this.counts,connections:this.stream.connections,frame_ms:e.value,warp_ms:t.value,decode_ms:i.value,latency_ms:n.value,holes:this.holes,stretched:this.stretched,exposure:this.ev,shown:this.drawn.length>0,age_ms:this.health.age,notice:this.health.notice,bytes_per_second:this.traffic.perSecond(),keyframe_bytes:this.keyframes.newest?.bytes??0,pictures:a.length,quads:a.reduce((o,l)=>o+l.quads,0)}}capture({camera:e=this.walker.camera,earlier:t=!0,layers:i=!0,fill:n=!0,...s}={}){let a=this.keyframes.pictures(e,{earlier:t,layers:i});this.warp.warp(a,e,this.near,{...s,exposure:this.ev});let o=this.warp.capture(n);this.dirty=!0;let{width:l,height:c}=this.warp.target;return{width:l,height:c,pixels:o}}measure(e=20,t={}){let i=this.keyframes.pictures(this.walker.camera,t),n=performance.now();for(let s=0;s<e;s++)this.warp.warp(i,this.walker.camera,this.near,{...t,direct:!1}),this.warp.present(),this.warp.finish();return this.dirty=!0,(performance.now()-n)/e}};var Hp=.8,rv=.5,sv=[-1,0,1].flatMap(r=>[-1,0,1].flatMap(e=>[-1,0,1].map(t=>[r,e,t]))),Do=class{constructor({origin:e,cell:t,dims:i,bits:n}){this.origin=e,this.cell=t,this.dims=i,this.bits=Uint8Array.from(atob(n),s=>s.charCodeAt(0))}filled(e){let[t,i,n]=e.map((c,h)=>Math.floor((c-this.origin[h])/this.cell)),[s,a,o]=this.dims;if(t<0||i<0||n<0||t>=s||i>=a||n>=o)return!1;let l=t+s*(i+a*n);return(this.bits[l>>3]>>(l&7)&1)===1}blocked(e,t){return t===0?this.filled(e):sv.some(i=>this.filled(lt(e,Ze(i,t*this.cell))))}move(e,t){let i=[Hp,Hp/2,0].find(o=>!this.blocked(e,o));if(i===void 0)return lt(e,t);let n=Math.max(1,Math.ceil(yt(t)/(rv*this.cell))),s=Ze(t,1/n),a=e;for(let o=0;o<n;o++){let l=lt(a,s);if(!this.blocked(l,i)){a=l;continue}let c=a;for(let h of[0,1,2]){let u=a.map((f,p)=>p===h?f+s[p]:f);s[h]!==0&&!this.blocked(u,i)&&(a=u)}if(a===c)break}return a}};var He=r=>document.getElementById(r),av={connecting:"connecting",live:"live",waiting:"reconnecting",failed:"stopped",closed:"closed"},ov=["\xB7 moving","\xB7 refined, nothing moves","\xB7 refined, outlines smooth"],lv=148,Wp=50,cv={lights:["direct_light","light_reach"],shadows:["shadow_map","soft_shadow","sky_shadow","point_shadow","pane_shadow","occluders"],ambient:["ambient_visibility"],reflections:["reflections","reflective_pixel","reflection_reuse","hit_shader","ray_caster"],transparency:["transparency"],media:["scattering"]},Un=r=>r==null?"\u2013":`${r>=100?Math.round(r):r.toFixed(r>=10?0:1)} ms`,No=r=>r==null?"\u2013":`${(100*r).toFixed(r<.1?2:1)} %`,Xp=r=>r<1e6?`${Math.round(r/1e3)} kB`:`${(r/1e6).toFixed(1)} MB`,Eh=r=>`${(r/1e3).toFixed(r<9950?1:0)} s`,Fo=class{constructor(){this.frames=[],this.state="connecting",this.detail={},He("toggle").addEventListener("click",()=>this.open(He("panel").hidden)),document.addEventListener("keydown",e=>e.code==="Escape"&&!He("panel").hidden&&this.open(!1))}open(e){He("panel").hidden=!e,He("toggle").setAttribute("aria-expanded",String(e)),He("brief").hidden=e,e?He("panel").scrollTop=0:He("panel").contains(document.activeElement)&&He("toggle").focus()}showState(e,t){this.state=e,this.detail=t,this.showNotice(null)}showNotice(e){let t=this.state==="waiting"?{text:"reconnecting",ms:1e3*this.detail.seconds,before:" in "}:null,{text:i,ms:n,before:s=" \xB7 "}=e??t??{text:av[this.state]};He("status").dataset.state=e?e.kind:this.state,He("status").title=this.detail?.reason??"",He("status-text").textContent!==i&&(He("status-text").textContent=i),He("status-time").textContent=n===void 0?"":s+Eh(n)}showScene(e){He("play-row").hidden=Object.keys(e.animations??{}).length===0}showPlan(e){let t=e.plan;if(!t)return;let i=t.rows??[];He("plan-kind").textContent=ov[e.still?e.samples>1?2:1:0],He("plan-statement").textContent=[t.statement,...t.warnings??[]].filter(Boolean).join(" \xB7 "),He("plan").replaceChildren(...i.map(s=>this.planRow(s))),He("plan").append(this.planRow({pass:"together",runs:!0,...t,reason:"",settings:""}));let n=i.some(s=>s.pass==="carried_light"&&s.runs);for(let[s,a]of Object.entries(cv)){let o=i.filter(f=>a.includes(f.pass)),l=o.filter(f=>f.runs),c=l.reduce((f,p)=>f+(p.measured_ms??p.predicted_ms??0),0),{checked:h}=He(`effect-${s}`),u=h?Un(c):`for others ${Un(c)}`;He(`cost-${s}`).textContent=l.length?u:n&&h?"carried":"nothing",He(`cost-${s}`).title=o.map(f=>`${f.pass.replaceAll("_"," ")}: ${f.reason}`).join(`
`)}}planRow(e){let t=document.createElement("tr");t.className=e.runs?"":"off";let i=document.createElement("td"),n=document.createElement("small"),s=typeof e.settings=="string"?e.settings:Object.entries(e.settings??{}).map(([o,l])=>`${o} ${l}`).join(", ");n.textContent=[e.reason,s].filter(Boolean).join(" \xB7 "),i.append(e.pass.replaceAll("_"," "),n);let a=[e.predicted_ms,e.measured_ms].map(o=>{let l=document.createElement("td");return l.textContent=e.runs?Un(o):"\u2013",l});return t.append(i,...a),t}addFrame(e){this.frames.push(e),this.frames.length>lv&&this.frames.shift()}showFigures(e){let t=e.frame_ms?Math.round(1e3/e.frame_ms):null;this.showNotice(e.notice);let i=e.age_ms===null?"picture current":`picture ${Eh(e.age_ms)} old`;e.shown?He("brief").textContent=t?`${t} fps \xB7 ${i} \xB7 ${No(e.holes)} filled \xB7 ${No(e.stretched)} stretched`:"":He("brief").textContent=t?`${t} fps \xB7 no picture of this scene yet`:"",!He("panel").hidden&&(He("s-frame").textContent=t?`${Un(e.frame_ms)} \xB7 ${t} fps`:"\u2013",He("s-age").textContent=e.shown?e.age_ms===null?"current":Eh(e.age_ms):"\u2013",He("s-warp").textContent=Un(e.warp_ms),He("s-holes").textContent=No(e.holes),He("s-stretched").textContent=No(e.stretched),He("s-drawn").textContent=`${e.pictures} images`,He("s-latency").textContent=Un(e.latency_ms),He("s-bandwidth").textContent=`${Xp(e.bytes_per_second)}/s`,He("s-keyframe").textContent=e.keyframe_bytes?Xp(e.keyframe_bytes):"\u2013",He("s-decode").textContent=Un(e.decode_ms),this.drawChart())}drawChart(){let e=He("chart"),t=e.getContext("2d"),{width:i,height:n}=e;t.clearRect(0,0,i,n),t.fillStyle="rgb(255 255 255 / 12%)",t.fillRect(0,n*(1-16.7/Wp),i,1),t.fillStyle="#e8a355",this.frames.forEach((s,a)=>{let o=Math.max(1,Math.min(1,s/Wp)*n);t.fillRect(i-2*(this.frames.length-a),n-o,1.4,o)})}};var me=r=>document.getElementById(r),jp=[15,2e3],qp=[.002,.3],Ah=10,Ch=["lights","shadows","ambient","reflections","transparency","media"],hv=r=>r<10?r.toPrecision(2):String(Math.round(r)),Yp=r=>r===0?0:100**(r/50-1),uv=([r,e],t)=>r*(e/r)**t,dv=([r,e],t)=>Math.log(t/r)/Math.log(e/r),Oo=r=>document.querySelector(`input[name=${r}]:checked`).value,ys=(r,e)=>{for(let t of document.querySelectorAll(`input[name=${r}]`))t.checked=t.value===e},Bo=class{constructor({initial:e,wish:t,show:i,resize:n}){this.hooks={wish:t,show:i,resize:n},this.touched=new Set,this.changed=!1,this.values={budget:150,error:.05},this.ignored={},this.restore(e),this.listen(),this.showAll()}listen(){let e=(i,n)=>()=>{n?.(),this.showAll(),this.hooks.wish(i)},t=i=>e(i,()=>this.changed=!0);for(let i of document.querySelectorAll("input[name=mode]"))i.addEventListener("change",e(i.value==="auto"?"auto":`${i.value} bound`));me("bound").addEventListener("input",()=>{this.values[this.mode]=uv(this.mode==="error"?qp:jp,me("bound").value/100),this.showAll()}),me("bound").addEventListener("change",()=>this.hooks.wish("the bound")),me("layers").addEventListener("input",()=>this.showAll()),me("layers").addEventListener("change",()=>this.hooks.wish("extra layers"));for(let[i,n]of[["density","fog density"],["asymmetry","fog g"]])me(i).addEventListener("input",()=>this.touched.add(i)&&this.showAll()),me(i).addEventListener("change",t(n));me("play").addEventListener("change",t("the animation")),me("play").addEventListener("change",()=>this.touched.add("play"),{capture:!0});for(let i of document.querySelectorAll("input[name=exposure-mode]"))i.addEventListener("change",t("exposure"));me("exposure").addEventListener("input",()=>{ys("exposure-mode","manual"),this.showAll(),this.hooks.show()}),me("exposure").addEventListener("change",t("exposure")),me("tone").addEventListener("change",t("the tone curve"));for(let i of Ch)me(`effect-${i}`).addEventListener("change",t(i==="ambient"?"ambient shading":i));for(let i of["use-earlier","use-layers","use-fill"])me(i).addEventListener("change",()=>this.hooks.show());me("enhance").addEventListener("input",()=>{this.showAll(),this.hooks.show()}),me("resolution").addEventListener("change",()=>this.hooks.resize())}get mode(){return Oo("mode")}bounds(){return{budget_ms:this.mode==="budget"?Math.round(this.values.budget):null,max_error:this.mode==="error"?Number(this.values.error.toPrecision(2)):null,layers:Number(me("layers").value)}}message(){let e=(t,i)=>this.touched.has(t)?i(Number(me(t).value)):null;return{...this.bounds(),density:e("density",Yp),asymmetry:e("asymmetry",t=>t/100),playing:this.touched.has("play")?me("play").checked:null,exposure:this.ev??Oo("exposure-mode"),tone_map:me("tone").value,off:this.off}}get ev(){return Oo("exposure-mode")==="manual"?Number(me("exposure").value)/Ah:null}get off(){return Ch.filter(e=>!me(`effect-${e}`).checked)}get sources(){return{earlier:me("use-earlier").checked,layers:me("use-layers").checked,fill:me("use-fill").checked,enhance:Number(me("enhance").value)/100}}forgetScene(){this.touched.clear(),me("play").checked=!1,me("density").value=50,me("asymmetry").value=0,this.showAll()}words(){let{budget_ms:e,max_error:t,layers:i}=this.bounds(),n=Oo("exposure-mode"),s=a=>me(a).checked?null:0;return{budget_ms:e,max_error:t,layers:i===2?null:i,ev:n==="manual"?this.ev:n==="auto"?"auto":null,tone:me("tone").value==="none"?null:me("tone").value,off:this.off.join(",")||null,fog:this.touched.has("density")?me("density").value:null,g:this.touched.has("asymmetry")?me("asymmetry").value:null,play:this.touched.has("play")&&me("play").checked?1:null,shape:Number(me("enhance").value)||null,pixels:me("resolution").value==="medium"?null:me("resolution").value,earlier:s("use-earlier"),extra:s("use-layers"),fill:s("use-fill")}}restore(e){let t=o=>e[o]!==void 0&&e[o]!=="",i=(o,[l,c],h)=>{let u=Number(e[o]);t(o)&&u>=l&&u<=c?h(u):t(o)&&this.ignore(o,e)},n=(o,l,c)=>{l.includes(e[o])?c(e[o]):t(o)&&this.ignore(o,e)},s=o=>[...me(o).options].map(l=>l.value);i("budget_ms",[1,1e6],o=>(this.values.budget=o)&&ys("mode","budget")),i("max_error",[1e-4,1],o=>(this.values.error=o)&&ys("mode","error")),i("layers",[0,4],o=>me("layers").value=o),i("shape",[0,100],o=>me("enhance").value=o);for(let[o,l,c]of[["fog","density",[0,100]],["g","asymmetry",[-99,99]]])i(o,c,h=>{me(l).value=h,this.touched.add(l)});e.play==="1"&&(me("play").checked=!0,this.touched.add("play")),e.ev==="auto"?ys("exposure-mode","auto"):i("ev",[-16,16],o=>{me("exposure").value=Ah*o,ys("exposure-mode","manual")}),n("tone",s("tone"),o=>me("tone").value=o);let a=(e.off??"").split(",").filter(Boolean);if(!a.every(o=>Ch.includes(o)))this.ignore("off",e);else for(let o of a)me(`effect-${o}`).checked=!1;n("pixels",s("resolution"),o=>me("resolution").value=o);for(let[o,l]of[["earlier","use-earlier"],["extra","use-layers"],["fill","use-fill"]])n(o,["0","1"],c=>me(l).checked=c==="1");this.changed=["ev","tone","off","fog","g","play"].some(o=>t(o)&&!(o in this.ignored))}ignore(e,t){this.ignored[e]=t[e]}showAll(){let e=this.mode==="error";me("bound-row").hidden=this.mode==="auto",me("bound-name").textContent=e?"largest error":"budget";let t=this.values[e?"error":"budget"];me("bound").value=100*dv(e?qp:jp,t),me("bound-value").textContent=e?t.toPrecision(2):`${Math.round(t)} ms`,me("layers-value").textContent=me("layers").value,me("enhance-value").textContent=`${me("enhance").value} %`,me("density-value").textContent=`${hv(Yp(Number(me("density").value)))} \xD7`,me("asymmetry-value").textContent=this.touched.has("asymmetry")?(Number(me("asymmetry").value)/100).toFixed(2):"own",this.ev!==null&&this.showExposure(this.ev)}showExposure(e){e!==null&&(this.ev===null&&(me("exposure").value=Ah*e),me("exposure-value").textContent=`${e>0?"+":e<0?"\u2212":""}${Math.abs(e).toFixed(1)} EV`)}};var pv=67324752,fv=33639248,mv=101010256,gv=2048,vv=33;function Rh(r,e){let t=new DataView(new ArrayBuffer(r)),i=0;return e(a=>t.setUint16((i+=2)-2,a,!0),a=>t.setUint32((i+=4)-4,a,!0)),new Uint8Array(t.buffer)}async function Zp(r){let e=[],t=[],i=0;for(let[o,l]of[...r].sort((c,h)=>c[0]<h[0]?-1:1)){let c=new TextEncoder().encode(o),h=new Uint8Array(await l.arrayBuffer()),u=Uu(h),f=(d,_)=>{for(let m of[20,gv,0,0,vv])d(m);for(let m of[u,h.length,h.length])_(m);d(c.length),d(0)},p=Rh(30,(d,_)=>(_(pv),f(d,_))),g=i;t.push(Rh(46,(d,_)=>{_(fv),d(20),f(d,_);for(let m of[0,0,0])d(m);_(0),_(g)}),c),e.push(p,c,h),i+=p.length+c.length+h.length}let n=t.reduce((o,l)=>o+l.length,0),s=t.length/2,a=Rh(22,(o,l)=>{l(mv);for(let c of[0,0,s,s])o(c);l(n),l(i),o(0)});return new Blob([...e,...t,a],{type:"application/zip"})}var vt=r=>document.getElementById(r),Jp="torchrender.own",_v=/\.(glb|gltf|obj|ply|stl|toml|zip)$/i,xv={glb:"model/gltf-binary",toml:"application/toml",zip:"application/zip"},Ih=()=>new Set(JSON.parse(localStorage.getItem(Jp)??"[]")),Kp=r=>localStorage.setItem(Jp,JSON.stringify([...r])),yv=r=>r.slice(r.lastIndexOf(".")+1).toLowerCase(),$p=r=>`${(r/1e6).toFixed(r<1e7?1:0)} MB`;async function Mv(r){let e=[...r.items].map(n=>n.webkitGetAsEntry?.()).filter(Boolean);if(!e.length)return[...r.files].map(n=>[n.name,n]);let t=[],i=async n=>{if(n.isFile){let a=await new Promise((o,l)=>n.file(o,l));t.push([n.fullPath.replace(/^\//,""),a]);return}let s=n.createReader();for(;;){let a=await new Promise((o,l)=>s.readEntries(o,l));if(!a.length)return;for(let o of a)await i(o)}};for(let n of e)await i(n);return t}var ko=class{constructor({key:e,ready:t,gone:i,tell:n}){this.hooks={key:e,ready:t,gone:i,tell:n},this.request=null,vt("add").addEventListener("click",()=>vt("upload").showModal()),vt("upload-close").addEventListener("click",()=>this.close()),vt("upload").addEventListener("cancel",()=>this.request?.abort()),vt("upload-files").addEventListener("change",()=>{this.send([...vt("upload-files").files].map(s=>[s.webkitRelativePath||s.name,s])),vt("upload-files").value=""}),vt("upload-delete").addEventListener("click",()=>this.remove());for(let s of["dragenter","dragover"])window.addEventListener(s,a=>{[...a.dataTransfer.types].includes("Files")&&(a.preventDefault(),document.body.classList.add("dropping"))});window.addEventListener("dragleave",s=>s.relatedTarget===null&&document.body.classList.remove("dropping")),window.addEventListener("drop",s=>{document.body.classList.remove("dropping"),s.dataTransfer.files.length&&(s.preventDefault(),vt("upload").open||vt("upload").showModal(),Mv(s.dataTransfer).then(a=>this.send(a)))})}close(){this.request?.abort(),vt("upload").close()}say(e,t=""){vt("upload-text").textContent=e,vt("upload-text").dataset.kind=t}async send(e){let t=e.map(([s])=>s).find(s=>_v.test(s));if(vt("upload-report").replaceChildren(),!t)return this.say("None of these files is a scene: GLB, glTF, OBJ, PLY, STL, TOML or ZIP.","bad");let i=t.slice(t.lastIndexOf("/")+1).replace(/\.\w+$/,""),n=e.length===1?xv[yv(t)]:void 0;this.say("reading the files");try{let s=n?e[0][1]:await Zp(e),a=await this.post(i,n??"application/zip",s);Kp(Ih().add(a.id)),this.report(a),this.hooks.ready(a),vt("upload").close()}catch(s){this.say(s.message,"bad")}finally{this.request=null,vt("upload-progress").hidden=!0}}post(e,t,i){let n=new XMLHttpRequest;this.request=n;let s=vt("upload-progress");return s.hidden=!1,s.value=0,n.upload.onprogress=({loaded:a,total:o})=>{s.value=a/o,this.say(a<o?`sending ${$p(a)} of ${$p(o)}`:"the server reads the scene")},new Promise((a,o)=>{n.onload=()=>{let l=n.response??{};n.status<300?a(l):o(new Error(l.detail??l.title??`the server answered ${n.status}`))},n.onerror=()=>o(new Error("the server cannot be reached")),n.onabort=()=>o(new Error("stopped")),n.open("POST",`v1/scenes?name=${encodeURIComponent(e.slice(0,80))}`),n.responseType="json",n.setRequestHeader("Content-Type",t),n.setRequestHeader("Accept","application/json"),this.hooks.key()&&n.setRequestHeader("Authorization",`Bearer ${this.hooks.key()}`),n.send(i)})}report({name:e,triangles:t,report:i={}}){let n=/^points \((\d+)\)$/.exec((i.read??[]).find(l=>l.startsWith("points ("))??""),s=n?`${Number(n[1]).toLocaleString("en")} points`:`${t.toLocaleString("en")} triangles`,a=i.not_used??[];this.say(`${e}: ${s}`,a.length?"partly":"good");let o=a.length>1?` and ${a.length-1} more (see Open)`:"";this.hooks.tell(`${e}: ${s}${a.length?`; not used: ${a[0]}${o}`:""}`);for(let[l,c]of[["not_used","not used"],["repaired","repaired"]])for(let h of i[l]??[]){let u=document.createElement("li");u.textContent=`${c}: ${h}`,vt("upload-report").append(u)}}showScene(e){this.shown=e,vt("upload-delete").hidden=!Ih().has(e)}async remove(){let e=this.shown,t=this.hooks.key()?{Authorization:`Bearer ${this.hooks.key()}`}:{},i=await fetch(`v1/scenes/${e}`,{method:"DELETE",headers:t});if(!i.ok&&i.status!==404)return this.say("The server does not delete it.","bad");let n=Ih();n.delete(e),Kp(n),this.say("deleted"),vt("upload-report").replaceChildren(),this.hooks.gone(e)}};var Hi=r=>document.getElementById(r),Sv=4,bv=400,wv=8e3,Tv=1600;async function Ev(r){try{await navigator.clipboard.writeText(r)}catch{let e=document.createElement("textarea");e.value=r,document.body.append(e),e.select(),document.execCommand("copy"),e.remove()}}var zo=class{constructor({client:e,name:t,settings:i,changed:n,link:s}){this.client=e,this.changed=n,this.cameras={},Hi("home").addEventListener("click",()=>this.go(e.walker.home)),Hi("cameras").addEventListener("change",()=>{this.go(this.cameras[Hi("cameras").value]??e.walker.home)});for(let o of document.querySelectorAll("input[name=controls]"))o.addEventListener("change",()=>{e.walker.setMode(o.value),this.showMode(),n()});let a=()=>({ev:i.ev,tone:i.message().tone_map});this.copies("copy-link",s),this.copies("copy-python",()=>du(e.walker,t(),a())),this.copies("copy-command",()=>pu(e.walker,t(),a())),this.listen()}copies(e,t){let i=Hi(e),n=i.textContent;i.addEventListener("click",async()=>{this.client.walker.camera&&(await Ev(t()),i.textContent="copied",setTimeout(()=>i.textContent=n,Tv))})}go(e){let{walker:t}=this.client;!e||!t.camera||(t.jumpTo(e),this.client.dirty=!0,this.changed())}showCameras(e){this.cameras=e;let t=Object.keys(e);Hi("cameras").replaceChildren(...t.map(i=>new Option(i.replaceAll("_"," "),i))),Hi("cameras").disabled=t.length<2}showMode(){let{mode:e}=this.client.walker;for(let t of document.querySelectorAll("input[name=controls]"))t.checked=t.value===e;document.body.dataset.controls=e}listen(){let{stage:e}=this.client.walker,t=null;e.addEventListener("pointerdown",i=>{t=i.isPrimary&&i.button===0?{x:i.clientX,y:i.clientY,at:performance.now()}:null}),e.addEventListener("pointerup",i=>{(t?Math.hypot(i.clientX-t.x,i.clientY-t.y):1/0)>Sv||performance.now()-t.at>bv||this.pick(i)}),e.addEventListener("dblclick",i=>{this.turn=!0,this.pick(i)})}pick(e){let t=this.client.walker.stage.getBoundingClientRect();this.client.pick(e.clientX-t.left,e.clientY-t.top)}showPicked(e){let t=e.triangle>=0,{walker:i}=this.client;this.turn&&t&&i.orbiting&&(i.orbitAbout(e.point),this.client.dirty=!0),this.turn=!1;let n=1e-6*this.client.diagonal,s=a=>a.map(o=>Math.abs(o)<n?"0":o.toPrecision(4)).join(", ");Hi("picked").hidden=!1,Hi("picked").textContent=t?`${e.name||"unnamed"} \xB7 ${e.material||"no material"} \xB7 triangle ${e.face} \xB7 (${s(e.point)})`:"nothing there",clearTimeout(this.timer),this.timer=setTimeout(()=>Hi("picked").hidden=!0,wv)}};var sf="living_room",af=[["low",320*180],["medium",640*360],["high",960*540],["full",1280*720]],Av=1.2,Cv=1500,Rv=400,Iv=500,Pv=12e3,Lv=400,et=r=>document.getElementById(r),Qe=ou(),Ph=(r,e,t)=>Number(Qe[r])>=e&&Number(Qe[r])<=t,Uv=(r,[e,t],i)=>Ph(r,e,t)?Number(Qe[r]):i,Qp=[1,8192],bs=Ph("width",...Qp)&&Ph("height",...Qp),Fe=null,Ss=null,of=null,cn=sessionStorage.getItem("torchrender.key"),Ms=null,Xt=Qe.scene??sf,Rt=null,ef=0,tf=0,nf=0,rf=0,Lh=new Set;function yr(r){et("message").hidden=!r,et("message").textContent=r??""}function Go(r){clearTimeout(nf),et("notice").hidden=!r,et("notice").textContent=r,nf=setTimeout(()=>et("notice").hidden=!0,Pv)}et("resolution").replaceChildren(...af.map(([r])=>new Option(r,r)));et("resolution").value="medium";et("resolution").disabled=bs;var Dn=new Fo,It=new Bo({initial:Qe,wish:r=>{Fe?.wish(It.message(),r),ln()},show:()=>{Fe&&(Fe.dirty=!0),ln()},resize:()=>{ws(),ln()}});function Uh(){if(bs)return[Number(Qe.width),Number(Qe.height)];let r=af.find(([n])=>n===et("resolution").value)[1],{innerWidth:e,innerHeight:t}=window,i=Math.sqrt(r*t/e);return[i*e/t,i].map(n=>Math.max(64,2*Math.round(n/2)))}function lf(){let[r,e]=Ms??Uh(),t=Math.min(window.innerWidth/r,window.innerHeight/e),i=!bs&&Math.abs(r/e*(window.innerHeight/window.innerWidth)-1)<.02;et("stage").style.width=i?"100vw":`${t*r}px`,et("stage").style.height=i?"100dvh":`${t*e}px`}function cf(){Ms=Uh();let r=Object.fromEntries(Object.entries(It.bounds()).filter(([,t])=>t!==null)),e=Uv("overscan",[1,2],Av);return{scene:Xt,width:Ms[0],height:Ms[1],overscan:e,...r}}function ws(){Fe&&Xt&&hf(cf())}function hf(r,e){lf(),yr(""),Fe.settings=It.changed?It.message():null,Fe.start(r,cn??void 0,e)}function Dv(r,e){r==="failed"&&e.status===404&&!Rt||(Dn.showState(r,e),r==="failed"&&e.status===401?uf(ws):r==="failed"?yr(e.status===404?Nv():e.message):r==="live"&&yr(""))}function Nv(){let{name:r}=Rt.find(e=>e.id===Xt)??{};return r?`The scene ${r.replaceAll("_"," ")} was deleted.`:"There is no such scene."}function uf(r){let e=et("key-dialog");e.addEventListener("close",()=>{cn=et("key").value,sessionStorage.setItem("torchrender.key",cn),r()},{once:!0}),e.open||e.showModal()}function ln(){clearTimeout(ef),ef=setTimeout(df,Lv)}function df(){if(!Fe?.walker.camera||!Xt)return;let{walker:r}=Fe,e=r.camera.world_from_camera.every((t,i)=>t===r.home.world_from_camera[i]);lu({scene:Xt===sf&&Qe.scene===void 0?null:Xt,view:e?null:cu(r),controls:r.mode===Fe.scene?.controls?null:r.mode,...It.words()})}function Fv(r,e){if(Fe.scene=r,Dn.showScene(r),of.showScene(r.id),!e)return;Lh=new Set,["walk","orbit"].includes(Qe.controls)?Fe.walker.setMode(Qe.controls):Qe.controls&&It.ignore("controls",Qe),delete Qe.controls;let t=hu(Qe.view,Fe.walker.camera,Fe.walker.up);t?Fe.walker.jumpTo(t):Qe.view&&It.ignore("view",Qe),delete Qe.view,Ov(),ln(),Ss.showMode(),Ss.showCameras({}),pf(r.id)}function Ov(){for(let e of["width","height"])Qe[e]!==void 0&&!bs&&It.ignore(e,Qe);let r=Object.entries(It.ignored).map(([e,t])=>`${e}=${t.slice(0,40)}`);r.length&&(Go(`The link says what is not known here, and was left out: ${r.join(", ")}`),ln()),It.ignored={}}function Bv({status:r,title:e,detail:t}){if(r===404)return;let i=!Fe.keyframes.newest&&Fe.walker.camera&&Fe.walker.camera!==Fe.walker.home;i&&Fe.walker.reset(),Go(`The server refuses: ${t||e}${i?"; the view is the scene's own":""}`),i&&ln()}function kv(r){let e=r.filter(t=>!Lh.has(t));if(!(!e.length||!et("notice").hidden)){for(let t of e)Lh.add(t);Go(e.join(" \xB7 "))}}function zv(r){Dn.showPlan(r),kv(r.plan?.warnings??[]);let e=r.revision??0;e!==rf&&(rf=e,clearTimeout(tf),tf=setTimeout(()=>{Fe.scene&&(pf(Fe.scene.id),Gv(Fe.scene.id))},Iv))}async function Gv(r){try{let e=await Cr(`v1/scenes/${r}`,{key:cn});Rt=Rt?.map(t=>t.id===r?e:t)??null,Rt&&Vo(),Fe.scene.id===r&&Dn.showScene(e)}catch(e){console.info(`the scene keeps its name: ${e.message}`)}}async function pf(r){try{let e=await Cr(`v1/scenes/${r}/survey`,{key:cn});if(Fe.scene.id!==r)return;Ss.showCameras(e.cameras),Fe.walker.obstacles=new Do(e.obstacles)}catch(e){console.info(`walls are not known: ${e.message}`)}}async function Vv(){for(;;)try{let r=[];for(let e="v1/scenes";e;){let t=await Cr(e,{key:cn,patience:1e4});r.push(...t.scenes),e=t.next}return r}catch(r){r instanceof Wn&&r.status===401?await new Promise(uf):await new Promise(e=>setTimeout(e,Cv))}}function Vo(){let r=e=>(e.name||e.id).replaceAll("_"," ");et("scene").replaceChildren(...Rt.map(e=>new Option(r(e),e.id))),et("scene").value=Xt}function Hv(r){Rt=r;let e=Xt,t=Rt.find(({id:i,name:n})=>i===e||n===e)??Rt[0];if(!t)return yr("The server has no scenes.");Qe.scene&&t.id!==e&&t.name!==e&&(It.ignore("scene",Qe),Qe.view&&It.ignore("view",Qe),delete Qe.view,delete Qe.scene),Xt=t.id,Vo(),et("scene").disabled=!1,et("scene").addEventListener("change",()=>{Dh(et("scene").value),et("scene").blur()}),(Xt!==e||Fe.state==="failed")&&ws()}function Dh(r){et("scene").value=r,delete Qe.view,Xt=Qe.scene=r,It.forgetScene(),ws()}function Wv(r){Rt??=[],Rt.some(({id:e})=>e===r.id)||Rt.push(r),Vo(),Dh(r.id)}function Xv(r){Rt=Rt.filter(e=>e.id!==r),Vo(),Rt.length?Dh(Rt[0].id):Xt=null}function jv(r){yr(r?"The graphics card dropped the picture. It comes back by itself in a moment.":"")}function qv(){window.torchrender=Object.freeze({get state(){return Fe.state},get stats(){return Fe.stats},get camera(){return structuredClone(Fe.walker.camera)},get controls(){return Fe.walker.mode},get walls(){return Fe.walker.obstacles!==null},get moving(){return Fe.moving},get keyframes(){return Fe.keyframes.groups.map(r=>structuredClone({...r.header,received:rl(r)}))},get scene(){return Fe.wishes?.scene??null},get picked(){return structuredClone(Fe.picked)},capture:r=>Fe.capture(r),measure:(r,e)=>Fe.measure(r,e)})}function Yv(){let r=()=>et("help").classList.add("done");for(let t of[et("stage"),et("stick")])t.addEventListener("pointerup",r);window.addEventListener("keyup",t=>t.code!=="Tab"&&r());let e=0;window.addEventListener("resize",()=>{lf(),clearTimeout(e),e=setTimeout(()=>!bs&&String(Uh())!==String(Ms)&&ws(),Rv)})}function Zv(){let r=cf(),e=pl(r,cn??void 0);Fe=new Uo(et("stage"),new Is(et("stage"),et("stick")),{state:Dv,keyframe:zv,frame:n=>Dn.addFrame(n),figures:n=>{Dn.showFigures(n),It.showExposure(n.exposure)},sources:()=>It.sources,exposure:()=>It.ev,context:jv,scene:Fv,moved:ln,refused:Bv,picked:n=>{Fe.picked=n,Ss.showPicked(n)},unable:n=>{Dn.showState("failed",{reason:n.message}),yr("This page needs WebGL2, which this browser does not offer. Try a current browser, or switch on hardware acceleration.")}});let t=()=>{let n=Rt?.find(s=>s.id===Xt);return n&&!n.built_in?`${n.name}.${n.kind==="zip"?"gltf":n.kind}`:Xt},i=()=>(df(),location.href);Ss=new zo({client:Fe,name:t,settings:It,changed:ln,link:i}),of=new ko({key:()=>cn,ready:Wv,gone:Xv,tell:Go}),qv(),Yv(),hf(r,e),Vv().then(Hv)}Zv();
/**
 * @license
 * Copyright 2010-2026 Three.js Authors
 * SPDX-License-Identifier: MIT
 */
